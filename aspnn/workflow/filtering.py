"""Logs to states, and what is found out about a vessel's sensors on the way."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from aspnn import records
from aspnn.angles import difference
from aspnn.estimation import filter_log, smooth_log
from aspnn.estimation.cascade import filter_file
from aspnn.estimation.course import filter_course
from aspnn.estimation.measurements import opening
from aspnn.estimation.mounting import Alignment, align
from aspnn.estimation.noise_file import with_noise_file, write_mounting_file, write_noise_file
from aspnn.estimation.over_ground import filter_over_ground
from aspnn.estimation.spatial import filter_spatial
from aspnn.estimation.tuning import Tuning, tune
from aspnn.frames import Zone, convergence
from aspnn.learning.windows import WindowSpec
from aspnn.records import Log, States
from aspnn.schema import InputError
from aspnn.vessel import Vessel
from aspnn.workflow.shared import Watch, silent

ZONE = math.radians(3.0)  # half the width of a UTM zone


def filter_files(
    logs: Sequence[str | Path],
    out: str | Path,
    smooth: bool = False,
    watch: Watch = silent,
    noise: str | Path | None = None,
    tell: Callable[[str], None] = lambda line: None,
    *,
    spatial: bool = False,
    course_only: bool = False,
    over_ground: bool = False,
) -> list[Path]:
    """Filter logs into `out` as NAME.states.parquet (and, smoothed, NAME.smoothed.parquet). Returns the state files.

    `noise` is a noise file in place of the noise and the calibration of the logs' vessel. `tell` gets a line on each log that
    lies outside its UTM zone. Logs are filtered in blocks; smoothing has the whole of one in memory, and so has filtering in
    three dimensions (`spatial`), by positions alone (`course_only`) or with course and speed over ground (`over_ground`), which
    exclude each other and smooth nothing.
    """
    others = (
        ("--spatial", spatial, filter_spatial),
        ("--course-only", course_only, filter_course),
        ("--over-ground", over_ground, filter_over_ground),
    )
    asked = [(option, by) for option, on, by in others if on]
    if len(asked) > 1:
        raise InputError(f"{asked[0][0]} and {asked[1][0]} are different filters; leave one of them out")
    if smooth and asked:
        raise InputError(f"--smooth is of the planar filter; leave out {asked[0][0]} or --smooth")
    whole = asked[0][1] if asked else None
    files = records.log_files(logs)
    tuned = None if noise is None else partial(with_noise_file, path=noise)
    made = []
    for file in watch(files, "filtering", len(files)):
        made.append(Path(out) / f"{Path(file).stem}.states.parquet")
        if whole is None:
            zone, place = filter_file(file, made[-1], tuned)
        else:
            zone, place = filter_whole_file(whole, file, made[-1], tuned)
        if zone is not None and abs(from_meridian(zone, place[1])) > ZONE:
            tell(f"{file}: lies outside its zone; {zone_line(zone, place)}")
        if smooth:
            log = with_noise(records.read_log(file), noise)
            records.write_states(smooth_log(log), made[-1].with_name(f"{Path(file).stem}.smoothed.parquet"))
    return made


def filter_whole_file(
    filtered: Callable[[Log], States], log: str | Path, out: str | Path, tuned: Callable[[Vessel], Vessel] | None = None
) -> tuple[Zone | None, np.ndarray]:
    """Filter a log file at once into the state file `out`; as `filter_file` where not said."""
    read = records.read_log(log)
    read = read if tuned is None else replace(read, vessel=tuned(read.vessel))
    records.write_states(filtered(read), out)
    middle = opening(replace(read, table=read.table.iloc[len(read) // 2 :])).place
    return read.zone, np.where(np.isnan(middle), opening(read).place, middle)


def mount_file(log: str | Path, out: str | Path | None = None, noise: str | Path | None = None) -> Alignment:
    """How the IMU of a log is mounted, written as a noise file `out` if one is named. Raises InputError for a wrong log."""
    read = with_noise(records.read_log(log), noise)
    found = align(read)
    if out is not None:
        write_mounting_file(read.vessel, found, log, out)
    return found


def from_meridian(zone: Zone, longitude: float) -> float:
    """How far east of the zone's central meridian a longitude [rad] lies, in rad."""
    return float(difference(longitude, math.radians(6 * zone.number - 183)))


def zone_line(zone: Zone, place) -> str:
    """What a zone makes of the place (latitude, longitude) [rad] in the middle of a log."""
    away = math.degrees(from_meridian(zone, place[1]))
    gamma = math.degrees(float(convergence(place[0], place[1], zone)))
    side = "east" if away >= 0 else "west"
    return f"zone {zone}: the middle of the log is {abs(away):.2f} deg {side} of the central meridian, grid convergence {gamma:+.2f} deg"


def with_noise(log: Log, noise: str | Path | None) -> Log:
    """The log of a vessel tuned by a noise file; as it is where none is named."""
    return log if noise is None else replace(log, vessel=with_noise_file(log.vessel, noise))


def tune_files(
    logs: Sequence[str | Path],
    out: str | Path,
    sensors: bool = False,
    delays: bool = False,
    heading: bool = False,
    watch: Watch = silent,
) -> Tuning:
    """Tune the noise of the one vessel of `logs` (with `delays` and `heading` its calibration too) into a noise file.

    The search starts from the vessel of the first log. Raises InputError when logs are of different vessels.
    """
    files = records.log_files(logs)
    read = [records.read_log(file) for file in watch(files, "reading", len(files))]
    first = read[0].vessel
    for file, log in zip(files, read, strict=True):
        if log.vessel.name != first.name:
            raise InputError(
                f"{file}: is of vessel {log.vessel.name}, {files[0]} of {first.name}; tune one vessel at a time"
            )
    tuning = tune(read, first, sensors, delays, heading, watch)
    write_noise_file(tuning, files, out)
    return tuning


def states_for(log: Log, *specs: WindowSpec) -> States:
    """The states of a log by the filter that networks with these specs learned from: in three dimensions, or by positions alone, if any did."""
    if any(spec.spatial for spec in specs):
        return filter_spatial(log)
    return filter_course(log) if any(spec.course_only for spec in specs) else filter_log(log)


def consistency_files(
    logs: Sequence[str | Path],
    report: str | Path | None = None,
    metrics: str | Path | None = None,
    runs: int = 0,
    seed: int = 0,
    watch: Watch = silent,
    noise: str | Path | None = None,
):
    """Consistency of the filters on each log, with errors where its truth lies beside it, and `runs` Monte Carlo runs.

    `noise` is a noise file in place of the noise and the calibration of the logs' vessel.
    Writes the HTML page and the JSON file where named, and returns a Consistency per log. Raises InputError.
    """
    from aspnn.evaluation.consistency import consistency, write_metrics
    from aspnn.evaluation.consistency_report import write_report

    files = records.log_files(logs)
    results = []
    for file in files if runs else watch(files, "filtering", len(files)):  # one bar at a time
        log = with_noise(records.read_log(file), noise)
        results.append(consistency(log, records.read_truth(log), runs, seed, watch))
    if metrics:
        write_metrics(results, metrics)
    if report:
        write_report(results, report)
    return results
