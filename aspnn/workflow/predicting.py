"""Predictions as text, and checkpoints as ONNX files."""

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from aspnn import records
from aspnn.estimation import filter_log
from aspnn.estimation.course import filter_course
from aspnn.records import Log, States
from aspnn.schema import InputError
from aspnn.vessel import Vessel
from aspnn.workflow.filtering import states_for

KINEMATIC = ("caa_ctra", "caa_cmm", "constant")


def predict_file(
    checkpoint: str | Path,
    log: str | Path,
    at: float,
    rudder: str | None,
    horizon: float | None,
    format: str,
    region_map: bool | None = None,
    fan: str | None = None,
    clear: str | None = None,
    swept: bool = False,
    soonest: bool = False,
    tell: Callable[[str], None] = lambda line: None,
    track: bool = False,
) -> str:
    """The path predicted from `at` [s] of a log as text in `format` (json, geojson, csv). Raises InputError.

    In place of a checkpoint the name of a kinematic predictor (caa_ctra, caa_cmm, constant) will do, which takes any vessel and
    logs without heading.
    `fan` predicts many orders in place of one plan (FROM:TO:STEP in degrees), `clear` judges by what is to be cleared
    (LAT,LON@METRES or FILE.geojson@METRES) and has `tell` say which order does, with `soonest` the one that is past first;
    `swept` adds the swept area. `track` corrects the network by what the log tells of the ship up to then (see prediction.tracking).
    """
    from aspnn.prediction import Predictor, writers
    from aspnn.prediction import fan as fans
    from aspnn.prediction.tracked import Tracked

    if fan is not None and rudder is not None:
        raise InputError("--fan and --rudder exclude each other: a fan holds each of its orders; leave one of them out")
    if clear is not None and fan is None:
        raise InputError("--clear chooses among the orders of a fan; add --fan FROM:TO:STEP, such as --fan -35:35:5")
    if soonest and clear is None:
        raise InputError(
            "--soonest chooses among the orders that clear something; add --clear, such as --clear 69.65,18.96@100"
        )
    if swept and format == "csv":
        raise InputError("--swept has no form in csv; use --format json or geojson")
    orders = None if fan is None else fans.parse_fan(fan)
    if kinematic(checkpoint):
        if orders is not None or rudder is not None or region_map is not None or track:
            raise InputError(
                f"{checkpoint}: kinematics know of no rudder, no region map and no tracking; leave those options out"
            )
        read = records.read_log(log)
        predictor = kinematic_predictor(str(checkpoint), read.vessel, horizon)
        states = kinematic_states(read, tell)
    else:
        predictor = Predictor.load(checkpoint)
        if region_map is not None:
            predictor = replace(predictor, region_map=region_map)
        if horizon is not None and horizon > predictor.horizon:
            raise InputError(
                f"--horizon {horizon:g} s is beyond the {predictor.horizon:g} s of checkpoint {checkpoint}"
            )
        if track:
            predictor = Tracked(predictor)
        states = states_for(records.read_log(log), predictor.spec)
    last = states["time_s"][-1]
    if not states["time_s"][0] <= at <= last:
        raise InputError(
            f"{log}: --at {at:g} s is outside the log, which runs from {states['time_s'][0]:g} to {last:g} s"
        )
    now = states.until(at)
    target = None if clear is None else fans.parse_clear(clear, now.zone)
    plan = None if rudder is None else parse_plan(rudder)
    path = predictor.predict(now, plan) if orders is None else fans.fan(predictor, now, orders)
    for warning in writers.warnings(path, predictor.name):
        tell(warning)
    if horizon is not None:
        path = path.at(path.time[path.time <= horizon + 1e-9])
    if orders is not None:
        notes, chosen = fans.judged(path, orders, now, target, tell, soonest)
        if format == "csv":
            return writers.fan_csv(path, notes, now)
        if format == "geojson":
            return writers.fan_geojson(path, notes, now, predictor.name, chosen)
        return writers.fan_json(path, notes, now, predictor.name, chosen, swept)
    if format == "csv":
        return writers.to_csv(path, now)
    if format == "geojson":
        return writers.to_geojson(path, now, predictor.name, swept=swept)
    return writers.to_json(path, now, predictor.name, swept)


def kinematic(checkpoint: str | Path) -> bool:
    """Whether this names a kinematic predictor, not a checkpoint."""
    return str(checkpoint) in KINEMATIC and not Path(checkpoint).exists()


def kinematic_predictor(name: str, vessel: Vessel, horizon: float | None):
    """The kinematic predictor of that name for `horizon` [s]; 90 without one."""
    from aspnn.prediction import KinematicPredictor, kinematic

    return KinematicPredictor(vessel, getattr(kinematic, name), horizon or 90.0)


def kinematic_states(log: Log, tell: Callable[[str], None]) -> States:
    """The states of a log for kinematics: by the planar filter, or where it has no heading by the course filter, which is told."""
    headings = log.table.get("heading_deg")
    if headings is not None and headings.notna().any():
        return filter_log(log)
    tell(
        f"{log.path or log.voyage}: has no heading; course and speed are those of its positions, and the bow may point elsewhere"
    )
    return filter_course(log)


def parse_plan(text: str) -> list[tuple[float, float]]:
    """Rudder plan [s, rad] from text such as `20` or `20@0,-10@30` (degrees at seconds from now). Raises InputError."""
    plan = []
    for part in text.split(","):
        angle, _, when = part.partition("@")
        try:
            plan.append((float(when or 0), math.radians(float(angle))))
        except ValueError:
            raise InputError(
                f"--rudder {text!r}: {part!r} is not DEG or DEG@SECONDS, such as 20 or 20@0,-10@30"
            ) from None
    return plan


def export_file(checkpoint: str | Path, file: str | Path):
    """Write a checkpoint as one ONNX file; returns the learning.export.Parity of each case. Raises InputError."""
    try:
        from aspnn.learning.export import export_onnx
    except ModuleNotFoundError as error:
        raise InputError(f"export: {error.name} is not installed; pip install aspnn[export]") from None
    return export_onnx(checkpoint, file)
