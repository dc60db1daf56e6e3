"""Commands on checkpoints: train, judge, predict, export."""

import sys
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from aspnn.cli.shared import Checkpoint, Logs, Quiet, app, say, watch


class Shape(StrEnum):
    """Formats that `predict` writes."""

    json = "json"
    geojson = "geojson"
    csv = "csv"


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
    steered: Annotated[
        float | None,
        typer.Option(help="Start every so many seconds where a loop is closed (autopilot): a population of its own."),
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Calibrate the regions of a checkpoint on voyages that did not train it; its weights stay as they are."""
    from aspnn.evaluation.calibrate import table
    from aspnn.workflow import calibrate_files, silent

    found = calibrate_files(checkpoint, logs, out, silent if quiet else watch, steered)
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
    steered: Annotated[
        float | None,
        typer.Option(help="Start every so many seconds too, whatever is ordered: voyages under an autopilot."),
    ] = None,
    track: Annotated[
        bool, typer.Option("--track", help="Each checkpoint also corrected by what the voyage tells of its ship.")
    ] = False,
    quiet: Quiet = False,
) -> None:
    """Measure a predictor on logs, beside the kinematic baselines and the oracle."""
    from aspnn.evaluation.evaluate import table
    from aspnn.workflow import evaluate_files, silent

    watched = silent if quiet else watch
    result = evaluate_files(
        [checkpoint, *(beside or [])], logs, report, json, seed, watch=watched, steered=steered, track=track
    )
    say(quiet, table(result))
    for path in (report, json):
        if path:
            say(quiet, f"written: {path}")


@app.command()
def predict(
    checkpoint: Annotated[
        Path,
        typer.Argument(
            help="Checkpoint folder, exported .onnx file, or caa_ctra, caa_cmm or constant.", show_default=False
        ),
    ],
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
    track: Annotated[
        bool, typer.Option("--track", help="Correct the network by what the log so far tells of the ship (loading).")
    ] = False,
) -> None:
    """Predict the path from one instant of a log, if a rudder plan (or each order of a fan) is followed."""
    from aspnn.workflow import predict_file

    text = predict_file(
        *(checkpoint, log, at, rudder, horizon, format.value, region_map),
        *(fan, clear, swept, soonest, lambda line: print(line, file=sys.stderr), track),
    )
    sys.stdout.write(text)


@app.command()
def track(
    log: Annotated[Path, typer.Argument(help="Canonical log with rudder angles or orders.", show_default=False)],
    checkpoint: Annotated[
        Path | None, typer.Argument(help="Checkpoint whose corrections are shown too.", show_default=False)
    ] = None,
) -> None:
    """Which ship is this today: Nomoto's K and T of a log, and how a checkpoint is to be corrected, with standard errors."""
    from aspnn.workflow import track_file

    for line in track_file(log, checkpoint):
        print(line)


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
