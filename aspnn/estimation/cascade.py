"""The two filters in a row, CAA then CTRA: from a log to navigation states, filtered or smoothed."""

from aspnn.estimation import compiled
from aspnn.estimation.measurements import from_log
from aspnn.estimation.models import heading_problem, motion_problem
from aspnn.estimation.states import table
from aspnn.records import Log, States, check_log


def filter_log(log: Log, engine=compiled) -> States:
    """States of a log, one row per epoch, each from the log up to that epoch. Raises InputError for a wrong log.

    `engine` is a module with `run` and `smooth`: `compiled`, or `reference` (filterpy).
    """
    return _estimate(log, engine, smoothed=False)


def smooth_log(log: Log, engine=compiled) -> States:
    """States of a log, each from the whole log: labels and reference paths, never inputs of a prediction.

    CAA is smoothed first; CTRA runs again on the smoothed heading and yaw rate, and is smoothed.
    """
    return _estimate(log, engine, smoothed=True)


def _estimate(log: Log, engine, smoothed: bool) -> States:
    check_log(log, log.path or "log")
    m, vessel = from_log(log), log.vessel
    size = vessel.service_speed, vessel.length
    problem = heading_problem(m, vessel.noise, *size)
    turning = engine.run(problem)
    heading = engine.smooth(problem, turning) if smoothed else (turning.mean, turning.covariance)
    problem = motion_problem(m, vessel.noise, heading[0], heading[1], *size)
    moving = engine.run(problem)
    motion = engine.smooth(problem, moving) if smoothed else (moving.mean, moving.covariance)
    return States(
        table=table(log, m, heading, motion, moving, None if smoothed else turning),
        vessel=vessel,
        zone=log.zone,
        start=log.start,
        source=log.source,
        voyage=log.voyage,
        smoothed=smoothed,
        path=log.path,
    )
