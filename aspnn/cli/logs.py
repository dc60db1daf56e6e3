"""Commands on logs: simulate, import, filter, and what is found out about their sensors."""

import sys
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from aspnn.cli.shared import Logs, NoiseFile, Out, Quiet, app, say, watch
from aspnn.schema import InputError


class Format(StrEnum):
    """Formats that `import` reads."""

    ais = "ais"
    csv = "csv"
    nmea0183 = "nmea0183"
    esso_osaka = "esso-osaka"
    n2k_yacht = "n2k-yacht"


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
        watched = silent if quiet else watch
        made = simulate_files(
            scenario, out, voyages, seed, watched, workers, scheduler, nmea, lambda line: say(quiet, line)
        )
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
    mmsi: Annotated[int | None, typer.Option(help="AIS: this ship alone.")] = None,
    quiet: Quiet = False,
) -> None:
    """Bring recorded logs into the canonical form."""
    from aspnn.workflow import import_files, silent

    watched = silent if quiet else watch
    for path, notes in import_files(format.value, sources, out, map, vessel, watched, noise, mmsi):
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
    course_only: Annotated[
        bool,
        typer.Option("--course-only", help="By positions alone, for vessels without a compass: course for heading."),
    ] = False,
    over_ground: Annotated[
        bool,
        typer.Option(
            "--over-ground", help="With course and speed over ground among the measurements, for AIS reports."
        ),
    ] = False,
    noise: NoiseFile = None,
    quiet: Quiet = False,
) -> None:
    """Filter logs into navigation states."""
    from aspnn.workflow import filter_files, silent

    chosen = {"spatial": spatial, "course_only": course_only, "over_ground": over_ground}
    made = filter_files(logs, out, smooth, silent if quiet else watch, noise, lambda line: say(quiet, line), **chosen)
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
def info(thing: Annotated[Path, typer.Argument(help="Checkpoint folder, log or states.", show_default=False)]) -> None:
    """Say what a checkpoint or a log holds."""
    from aspnn.workflow import describe

    for line in describe(thing):
        say(False, line)
