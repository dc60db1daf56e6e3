"""The two filters in a row, CAA then CTRA: from a log to navigation states, filtered or smoothed."""

from dataclasses import dataclass

from aspnn.estimation import compiled
from aspnn.estimation.compiled import Run
from aspnn.estimation.exact import heading_problem, motion_problem
from aspnn.estimation.measurements import Measurements, from_log
from aspnn.estimation.problem import Problem
from aspnn.estimation.states import table
from aspnn.records import Log, States, check_log


@dataclass(frozen=True)
class Cascade:
    """What the two filters made of a log: its measurements, then problem and run of CAA and of CTRA."""

    measurements: Measurements
    turn: Problem
    turning: Run
    motion: Problem
    moving: Run


def run_cascade(log: Log, engine=compiled) -> Cascade:
    """Both filters over a log, CTRA on the filtered heading and yaw rate. Raises InputError for a wrong log."""
    check_log(log, log.path or "log")
    m, vessel = from_log(log), log.vessel
    size = vessel.service_speed, vessel.length
    turn = heading_problem(m, vessel.noise, *size)
    turning = engine.run(turn)
    motion = motion_problem(m, vessel.noise, turning.mean, turning.covariance, *size)
    return Cascade(m, turn, turning, motion, engine.run(motion))


def filter_log(log: Log, engine=compiled) -> States:
    """States of a log, one row per epoch, each from the log up to that epoch. Raises InputError for a wrong log.

    `engine` is a module with `run` and `smooth`: `compiled`, or `reference` (filterpy).
    """
    c = run_cascade(log, engine)
    heading, motion = (c.turning.mean, c.turning.covariance), (c.moving.mean, c.moving.covariance)
    return _states(log, table(log, c.measurements, heading, motion, c.moving, c.turning), smoothed=False)


def smooth_log(log: Log, engine=compiled) -> States:
    """States of a log, each from the whole log: labels and reference paths, never inputs of a prediction.

    CAA is smoothed first; CTRA runs again on the smoothed heading and yaw rate, and is smoothed.
    """
    check_log(log, log.path or "log")
    m, vessel = from_log(log), log.vessel
    size = vessel.service_speed, vessel.length
    turn = heading_problem(m, vessel.noise, *size)
    heading = engine.smooth(turn, engine.run(turn))
    motion = motion_problem(m, vessel.noise, *heading, *size)
    moving = engine.run(motion)
    return _states(log, table(log, m, heading, engine.smooth(motion, moving), moving, None), smoothed=True)


def _states(log: Log, table, smoothed: bool) -> States:
    return States(
        table=table,
        vessel=log.vessel,
        zone=log.zone,
        start=log.start,
        source=log.source,
        voyage=log.voyage,
        smoothed=smoothed,
        path=log.path,
    )
