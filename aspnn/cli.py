"""The `aspnn` command: parse, call, print. No numerics here, and nothing heavy is imported before a command runs."""

import sys
from collections.abc import Callable, Iterable
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from aspnn.schema import InputError

app = typer.Typer(
    help="aspnn, the open advanced ship predictor: where the hull will be 10 to 90 s after a rudder order.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # the boxes would double the time of --help
)

Out = Annotated[Path, typer.Option("--out", help="Folder that receives the files.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Print errors only.")]
Logs = Annotated[list[Path], typer.Argument(help="Canonical logs: files or folders.", show_default=False)]
NoiseFile = Annotated[
    Path | None, typer.Option("--noise", help="Noise file (of `aspnn tune`) in place of the vessel's noise and delays.")
]
Checkpoint = Annotated[Path, typer.Argument(help="Checkpoint folder.", show_default=False)]


class Format(StrEnum):
    """Formats that `import` reads."""

    csv = "csv"
    nmea0183 = "nmea0183"
    esso_osaka = "esso-osaka"
    n2k_yacht = "n2k-yacht"


class Shape(StrEnum):
    """Formats that `predict` writes."""

    json = "json"
    geojson = "geojson"
    csv = "csv"


class Manoeuvre(StrEnum):
    """Trials that `trial` runs."""

    turning_circle = "turning-circle"
    zigzag = "zigzag"
    williamson = "williamson"
    pull_out = "pull-out"
    spiral = "spiral"
    stopping = "stopping"


def watch(things: Iterable, what: str, count: int) -> Iterable:
    """A progress bar on standard error around `things`, silent when that is no terminal."""
    from rich.console import Console
    from rich.progress import track

    console = Console(stderr=True)
    return track(things, what, total=count, console=console, disable=not console.is_terminal, transient=True)


def say(quiet: bool, text: Any) -> None:
    """Print a line (or a table) unless quiet."""
    if not quiet:
        from rich.console import Console

        # A pipe has no width: tables must not be cut there.
        Console(width=None if sys.stdout.isatty() else 140, highlight=False, soft_wrap=isinstance(text, str)).print(
            text
        )


@app.command()
def simulate(
    scenario: Annotated[Path, typer.Argument(help="Scenario file (data/scenarios/*.toml).", show_default=False)],
    out: Out,
    seed: Annotated[int | None, typer.Option(help="Seed in place of the scenario's.", min=0)] = None,
    voyages: Annotated[int | None, typer.Option(help="Number of voyages in place of the scenario's.", min=1)] = None,
    workers: Annotated[
        int | None, typer.Option(help="Processes; without it as many as there are cores and work for.", min=1)
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option(help="Dask scheduler, tcp://HOST:PORT, or local for a cluster on this machine.")
    ] = None,
    nmea: Annotated[
        bool, typer.Option("--nmea", help="Write VOYAGE.nmea too: the log as a ship's recorded NMEA 0183 sentences.")
    ] = False,
    quiet: Quiet = False,
) -> None:
    """Simulate voyages of a scenario: a log and its truth per voyage. A run that was stopped goes on when called again."""
    from aspnn.workflow import silent, simulate_files

    if workers and scheduler not in (None, "local"):
        raise InputError(f"--workers is for this machine; the scheduler {scheduler} has workers of its own")
    try:
        made = simulate_files(scenario, out, voyages, seed, silent if quiet else watch, workers, scheduler, nmea)
    except KeyboardInterrupt as stop:  # typer would end without a word
        sys.stderr.write(f"stopped: {stop}\n" if str(stop) else "stopped\n")
        raise typer.Exit(130) from None
    say(quiet, f"{len(made)} voyages in {out}")


@app.command("import")
def import_(
    format: Annotated[Format, typer.Argument(help="Format of the sources.", show_default=False)],
    sources: Annotated[list[Path], typer.Argument(help="Recorded files or folders.", show_default=False)],
    out: Out,
    map: Annotated[Path | None, typer.Option("--map", help="Map of columns, units, signs and antennas (TOML).")] = None,
    vessel: Annotated[
        str | None, typer.Option(help="Vessel in place of the map's: a packaged name or a .json file.")
    ] = None,
    noise: NoiseFile = None,
    quiet: Quiet = False,
) -> None:
    """Bring recorded logs into the canonical form."""
    from aspnn.workflow import import_files, silent

    for path, notes in import_files(format.value, sources, out, map, vessel, silent if quiet else watch, noise):
        say(quiet, f"{path}: {notes}")


@app.command("filter")
def filter_(
    logs: Logs,
    out: Out,
    smooth: Annotated[
        bool, typer.Option("--smooth", help="Write the smoothed states too (labels, never inputs).")
    ] = False,
    spatial: Annotated[
        bool, typer.Option("--spatial", help="In three dimensions, for boats that roll and pitch: by attitude and IMU.")
    ] = False,
    noise: NoiseFile = None,
    quiet: Quiet = False,
) -> None:
    """Filter logs into navigation states."""
    from aspnn.workflow import filter_files, silent

    watched = silent if quiet else watch
    made = filter_files(logs, out, smooth, watched, noise, lambda line: say(quiet, line), spatial)
    say(quiet, f"{len(made)} state files in {out}")


@app.command()
def mount(
    log: Annotated[
        Path,
        typer.Argument(help="Canonical log with imu_force columns, of a run that changes speed.", show_default=False),
    ],
    out: Annotated[
        Path | None, typer.Option("--out", help="Noise file (JSON) to write, for --noise.", show_default=False)
    ] = None,
    noise: NoiseFile = None,
    quiet: Quiet = False,
) -> None:
    """Find how an IMU is mounted: its axes and residual angles, as the section imu of a vessel file."""
    import json

    from aspnn.workflow import mount_file

    found = mount_file(log, out, noise)
    for line in found.lines():
        say(quiet, line)
    print(f'"imu": {json.dumps(found.section())}')
    if out:
        say(quiet, f"written: {out}")


@app.command()
def tune(
    logs: Logs,
    out: Annotated[Path, typer.Option("--out", help="Noise file (JSON) to write.", show_default=False)],
    sensors: Annotated[bool, typer.Option("--sensors", help="Tune the sensors' standard deviations too.")] = False,
    delays: Annotated[bool, typer.Option("--delays", help="Estimate how late the sensors are.")] = False,
    heading: Annotated[
        bool, typer.Option("--heading-offset", help="Estimate what the compass reads too much (two antennas).")
    ] = False,
    quiet: Quiet = False,
) -> None:
    """Tune a vessel's noise on its logs by maximum likelihood: a noise file for --noise."""
    from aspnn.estimation.noise_file import table
    from aspnn.workflow import silent, tune_files

    tuning = tune_files(logs, out, sensors, delays, heading, silent if quiet else watch)
    say(quiet, table(tuning))
    say(quiet, f"log-likelihood per epoch {tuning.before:.4f} before, {tuning.after:.4f} after; written: {out}")


@app.command()
def windows(
    logs: Logs,
    spec: Annotated[Path, typer.Option("--spec", help="Training file that says what windows hold.")],
    out: Out,
    quiet: Quiet = False,
) -> None:
    """Cut windowed datasets for training and validation out of logs."""
    from aspnn.workflow import silent, window_files

    for path, count in window_files(logs, spec, out, silent if quiet else watch):
        say(quiet, f"{count} windows in {path}")


@app.command()
def train(
    config: Annotated[Path, typer.Argument(help="Training file (training/*.toml).", show_default=False)],
    start: Annotated[
        Path | None, typer.Option("--from", help="Checkpoint to fine-tune: its network learns on from these logs.")
    ] = None,
    seed: Annotated[int | None, typer.Option(help="Seed in place of the file's.")] = None,
    out: Annotated[Path | None, typer.Option(help="Run folder; runs/NAME without it.")] = None,
    checkpoint: Annotated[Path | None, typer.Option(help="Folder for a second copy of the bundle.")] = None,
    devices: Annotated[int, typer.Option(help="Processes that share each batch on this machine.", min=1)] = 1,
    num_nodes: Annotated[
        int,
        typer.Option(help="Machines that train together; each needs MASTER_ADDR, MASTER_PORT and NODE_RANK.", min=1),
    ] = 1,
    quiet: Quiet = False,
) -> None:
    """Train a predictor. A run that was killed goes on where it was when called again."""
    from aspnn.workflow import silent, train

    watched = silent if quiet else watch
    folder = train(
        config, out, seed, checkpoint, quiet, watched, devices, num_nodes, start, lambda line: say(quiet, line)
    )
    say(quiet, f"checkpoint in {folder}")


@app.command()
def search(
    config: Annotated[Path, typer.Argument(help="Training file (training/*.toml).", show_default=False)],
    trials: Annotated[int, typer.Option(help="Trials to come to, those of earlier calls included.", min=1)],
    processes: Annotated[int, typer.Option(help="Processes that share the trials.", min=1)] = 1,
    out: Annotated[Path | None, typer.Option(help="Search folder; runs/NAME-search without it.")] = None,
    seed: Annotated[int, typer.Option(help="Seed of what is tried.", min=0)] = 0,
    quiet: Quiet = False,
) -> None:
    """Search for better settings of a training file, by validation loss. A search that was stopped goes on when called again."""
    from aspnn.learning.search import table
    from aspnn.workflow import search_file, silent

    try:
        watched = silent if quiet else watch
        found = search_file(config, trials, processes, out, seed, lambda line: say(quiet, line), watched)
    except KeyboardInterrupt as stop:  # typer would end without a word
        sys.stderr.write(f"stopped: {stop}\n" if str(stop) else "stopped\n")
        raise typer.Exit(130) from None
    say(quiet, table(found))
    for path in (found.table, found.config):
        say(quiet, f"written: {path}")


@app.command()
def calibrate(
    checkpoint: Checkpoint,
    logs: Logs,
    out: Annotated[
        Path | None, typer.Option("--out", help="Folder for a calibrated copy; without it the checkpoint itself.")
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Calibrate the regions of a checkpoint on voyages that did not train it; its weights stay as they are."""
    from aspnn.evaluation.calibrate import table
    from aspnn.workflow import calibrate_files, silent

    found = calibrate_files(checkpoint, logs, out, silent if quiet else watch)
    say(quiet, table(found))
    say(quiet, f"calibrated: {out or checkpoint}")


@app.command()
def choose(
    checkpoint: Checkpoint,
    logs: Logs,
    out: Annotated[
        Path | None, typer.Option("--out", help="Folder for a copy with the choice; without it the checkpoint itself.")
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Choose on voyages that did not train a checkpoint where kinematics serve better; its weights stay as they are."""
    from aspnn.evaluation.choose import table
    from aspnn.workflow import choose_files, silent

    found = choose_files(checkpoint, logs, out, lambda line: say(quiet, line), silent if quiet else watch)
    say(quiet, table(found))
    if not found.idle:
        say(quiet, f"chosen: {out or checkpoint}")


@app.command()
def evaluate(
    checkpoint: Checkpoint,
    logs: Logs,
    beside: Annotated[list[Path] | None, typer.Option(help="Further checkpoints, on the same windows.")] = None,
    report: Annotated[Path | None, typer.Option(help="HTML report to write.")] = None,
    json: Annotated[Path | None, typer.Option("--json", help="metrics.json to write.")] = None,
    seed: Annotated[int, typer.Option(help="Seed of the bootstrap.")] = 0,
    quiet: Quiet = False,
) -> None:
    """Measure a predictor on logs, beside the kinematic baselines and the oracle."""
    from aspnn.evaluation.evaluate import table
    from aspnn.workflow import evaluate_files, silent

    watched = silent if quiet else watch
    result = evaluate_files([checkpoint, *(beside or [])], logs, report, json, seed, watch=watched)
    say(quiet, table(result))
    for path in (report, json):
        if path:
            say(quiet, f"written: {path}")


@app.command()
def consistency(
    logs: Logs,
    report: Annotated[Path | None, typer.Option(help="HTML report to write.")] = None,
    json: Annotated[Path | None, typer.Option("--json", help="JSON file to write.")] = None,
    runs: Annotated[
        int, typer.Option(help="Monte Carlo runs per log, sensor noise drawn anew (simulated logs only).", min=0)
    ] = 0,
    seed: Annotated[int, typer.Option(help="Seed of the Monte Carlo.", min=0)] = 0,
    noise: NoiseFile = None,
    quiet: Quiet = False,
) -> None:
    """Judge the filters on logs: are innovations and errors as large and as random as they say?"""
    from aspnn.evaluation.consistency_report import table
    from aspnn.workflow import consistency_files, silent

    result = consistency_files(logs, report, json, runs, seed, silent if quiet else watch, noise)
    for path in (report, json):
        if path:
            say(quiet, f"written: {path}")
    say(quiet, table(result))  # its last lines are the verdict


@app.command()
def predict(
    checkpoint: Annotated[Path, typer.Argument(help="Checkpoint folder or exported .onnx file.", show_default=False)],
    log: Annotated[Path, typer.Argument(help="Canonical log.", show_default=False)],
    at: Annotated[float, typer.Option("--at", help="Start of the prediction [s] from the start of the log.")],
    rudder: Annotated[
        str | None, typer.Option(help="Rudder plan, DEG or DEG@T,... [s from the start]; held as it is without it.")
    ] = None,
    horizon: Annotated[float | None, typer.Option(help="Horizon [s]; the checkpoint's without it.", min=0.1)] = None,
    format: Annotated[Shape, typer.Option(help="Format of the output.")] = Shape.json,
    region_map: Annotated[
        bool | None,
        typer.Option("--region-map/--exact", help="Path by the region-mapped pivot point, or by the exact step."),
    ] = None,
    fan: Annotated[
        str | None,
        typer.Option(help="What if: rudder orders FROM:TO:STEP [deg], each held from now on, in place of --rudder."),
    ] = None,
    clear: Annotated[
        str | None,
        typer.Option(help="Which order of the fan keeps hull and region off LAT,LON@METRES or FILE.geojson@METRES?"),
    ] = None,
    soonest: Annotated[
        bool,
        typer.Option("--soonest", help="Of the orders that clear, the one past it soonest, not the smallest change."),
    ] = False,
    swept: Annotated[
        bool, typer.Option("--swept", help="Add the area that the hull sweeps (a fan's GeoJSON always has it).")
    ] = False,
) -> None:
    """Predict the path from one instant of a log, if a rudder plan (or each order of a fan) is followed."""
    from aspnn.workflow import predict_file

    text = predict_file(
        *(checkpoint, log, at, rudder, horizon, format.value, region_map),
        *(fan, clear, swept, soonest, lambda line: print(line, file=sys.stderr)),
    )
    sys.stdout.write(text)


@app.command()
def export(
    checkpoint: Checkpoint,
    onnx: Annotated[Path, typer.Option("--onnx", help="ONNX file to write.", show_default=False)],
    quiet: Quiet = False,
) -> None:
    """Export a checkpoint as one ONNX file, which `predict` runs without torch."""
    from aspnn.workflow import export_file

    cases = export_file(checkpoint, onnx)
    worst = max(case.difference for case in cases)
    say(quiet, f"written: {onnx}, {onnx.stat().st_size / 1e3:.0f} kB")
    say(quiet, f"within {worst:.1g} m/s of torch over {len(cases)} batch sizes and lengths")


@app.command()
def trial(
    vessel: Annotated[str, typer.Argument(help="Vessel: a packaged name or a .json file.", show_default=False)],
    manoeuvre: Annotated[Manoeuvre, typer.Argument(help="Manoeuvre.", show_default=False)],
    rudder: Annotated[
        float | None, typer.Option(help="Rudder angle [deg]; without it the usual one: 35, 10 and 20, 20, 15.")
    ] = None,
    speed: Annotated[float | None, typer.Option(help="Test speed [kn]; the service speed without it.")] = None,
    json: Annotated[Path | None, typer.Option("--json", help="JSON file to write.")] = None,
    plot: Annotated[Path | None, typer.Option("--plot", help="Figure to write: .png, .svg or .pdf.")] = None,
    quiet: Quiet = False,
) -> None:
    """Run a manoeuvring trial and judge it by IMO MSC.137(76). A criterion that is not met is no error: exit code 0."""
    from aspnn.evaluation.trial_report import table
    from aspnn.workflow import trial_files

    found = trial_files(vessel, manoeuvre.value, rudder, speed, json, plot)
    say(quiet, table(found))
    for path in (json, plot):
        if path:
            say(quiet, f"written: {path}")


@app.command()
def info(thing: Annotated[Path, typer.Argument(help="Checkpoint folder, log or states.", show_default=False)]) -> None:
    """Say what a checkpoint or a log holds."""
    from aspnn.workflow import describe

    for line in describe(thing):
        say(False, line)


vessel_app = typer.Typer(help="Vessel files.", no_args_is_help=True, rich_markup_mode=None)
app.add_typer(vessel_app, name="vessel")


@vessel_app.command()
def estimate(
    length: Annotated[float, typer.Option(help="Length between perpendiculars [m].", show_default=False)],
    beam: Annotated[float, typer.Option(help="Beam [m].", show_default=False)],
    draught: Annotated[float, typer.Option(help="Draught [m].", show_default=False)],
    cb: Annotated[
        float, typer.Option(help="Block coefficient, displacement / (length x beam x draught).", show_default=False)
    ],
    out: Annotated[Path, typer.Option("--out", help="Vessel file (.json) to write.", show_default=False)],
    name: Annotated[str | None, typer.Option(help="Name of the vessel; without it the file's.")] = None,
    length_overall: Annotated[float | None, typer.Option(help="Length overall [m].")] = None,
    speed: Annotated[float | None, typer.Option(help="Service speed [kn].")] = None,
    power: Annotated[float | None, typer.Option(help="Engine power at that speed [kW].")] = None,
    rpm: Annotated[float | None, typer.Option(help="Propeller's revolutions per minute at that speed.")] = None,
    propeller_diameter: Annotated[float | None, typer.Option(help="Propeller diameter [m].")] = None,
    rudder_area: Annotated[float | None, typer.Option(help="Rudder area [m2].")] = None,
    rudder_span: Annotated[float | None, typer.Option(help="Rudder span [m].")] = None,
    draws: Annotated[int, typer.Option(help="Ships drawn to say how sure its manoeuvres are; 0 for none.", min=0)] = 60,
    seed: Annotated[int, typer.Option(help="Seed of the draws.", min=0)] = 0,
    quiet: Quiet = False,
) -> None:
    """Estimate a vessel file from main dimensions, and say how sure it is."""
    from aspnn.simulation.estimate.sureness import table, told
    from aspnn.simulation.estimate.vessel_file import KNOT, Particulars
    from aspnn.workflow import estimate_vessel, silent

    given = Particulars(
        *(length, beam, draught, cb),
        name=name or out.stem,
        length_overall=length_overall,
        speed=None if speed is None else speed * KNOT,
        power=None if power is None else power * 1e3,
        shaft=None if rpm is None else rpm / 60,
        propeller_diameter=propeller_diameter,
        rudder_area=rudder_area,
        rudder_span=rudder_span,
    )
    found, ranges = estimate_vessel(given, out, draws, seed, silent if quiet else watch)
    say(quiet, table(found))
    for line in (*(f"warning: {text}" for text in found.warnings), *told(found, ranges, draws), f"written: {out}"):
        say(quiet, line)


def guarded(run: Callable[[], Any]) -> None:
    """Run a command or a script. What a user got wrong is one line on standard error and exit code 2."""
    try:
        run()
    except InputError as error:
        sys.stderr.write(f"error: {error}\n")
        sys.exit(2)
    except OSError as error:
        sys.stderr.write(f"error: {error.filename or 'file'}: {error.strerror or error}\n")
        sys.exit(2)
    except KeyboardInterrupt:
        sys.stderr.write("stopped\n")
        sys.exit(130)


def main() -> None:
    """The `aspnn` command."""
    guarded(app)


if __name__ == "__main__":
    main()
