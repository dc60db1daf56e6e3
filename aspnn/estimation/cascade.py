"""The two filters in a row, CAA then CTRA: from a log to navigation states, filtered or smoothed.

A log is filtered in blocks, so that memory does not grow with it: what a block leaves for the next (`Memory`) makes the
states those of the log in one piece, to the last bit.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

from aspnn import checks, records
from aspnn.checks import check_log
from aspnn.estimation import compiled
from aspnn.estimation.compiled import Run
from aspnn.estimation.exact import heading_problem, motion_problem
from aspnn.estimation.measurements import (
    Measurements,
    Opening,
    Past,
    check_opening,
    from_block,
    from_log,
    joined,
    opening,
)
from aspnn.estimation.problem import Carry, Problem
from aspnn.estimation.rows import Rows
from aspnn.estimation.states import Held, estimates
from aspnn.frames import Zone
from aspnn.records import Log, States
from aspnn.vessel import Vessel

BLOCK = 36_000  # rows of a log that are filtered at once: an hour at 10 Hz


@dataclass(frozen=True)
class Cascade:
    """What the two filters made of a log: its measurements, then problem and run of CAA and of CTRA."""

    measurements: Measurements
    turn: Problem
    turning: Run
    motion: Problem
    moving: Run


@dataclass(frozen=True)
class Memory:
    """What a block of a log leaves for the next: for screening, for CAA and CTRA, and for the table of states."""

    past: Past
    filters: tuple[Carry, Carry]
    held: Held


def run_cascade(log: Log, engine=compiled) -> Cascade:
    """Both filters over a log, CTRA on the filtered heading and yaw rate. Raises InputError for a wrong log."""
    check_log(log, log.path or "log")
    return _run(log, from_log(log), None, engine)


def _run(log: Log, m: Measurements, before: tuple[Carry, Carry] | None, engine) -> Cascade:
    vessel = log.vessel
    size = vessel.service_speed, vessel.length
    heading, motion = (None, None) if before is None else before
    turn = heading_problem(m, vessel.noise, *size, heading)
    turning = engine.run(turn, heading)
    move = motion_problem(m, vessel.noise, turning.mean, turning.covariance, size[0], size[1], before)
    return Cascade(m, turn, turning, move, engine.run(move, motion))


def filter_blocks(log: Log, begin: Opening, blocks: Iterable[pd.DataFrame], engine=compiled) -> Iterator[pd.DataFrame]:
    """Tables of states of the `blocks` of a log that begins as `begin`; of `log` all counts but the rows."""
    memory: Memory | None = None
    for block in blocks:
        states, memory = _filter_block(replace(log, table=block), begin, memory, engine)
        yield pd.DataFrame(states)


def filter_rows(
    log: Log, rows: Rows, begin: Opening, memory: Memory | None, engine=compiled
) -> tuple[dict[str, np.ndarray], Memory]:
    """States of a few `rows` of a log that begins as `begin`, by their columns, and what they leave for the next ones.

    They are those of `filter_log` to the last bit, at a third of the time that a table of one row takes. Of `log` all counts
    but the rows; `memory` is that of the rows before, None at the beginning.
    """
    return _filter_block(replace(log, table=rows), begin, memory, engine)  # type: ignore[arg-type]


def _filter_block(log: Log, begin: Opening, memory: Memory | None, engine) -> tuple[dict[str, np.ndarray], Memory]:
    m, past = from_block(log, begin, None if memory is None else memory.past)
    c = _run(log, m, None if memory is None else memory.filters, engine)
    held = Held.before(begin, float(m.time[0])) if memory is None else memory.held
    heading, motion = (c.turning.mean, c.turning.covariance), (c.moving.mean, c.moving.covariance)
    states, held = estimates(log, m, heading, motion, c.moving, c.turning, held)
    return states, Memory(past, (c.turning.carry, c.moving.carry), held)


def filter_log(log: Log, engine=compiled, rows: int = BLOCK) -> States:
    """States of a log, one row per epoch, each from the log up to that epoch. Raises InputError for a wrong log.

    `engine` is a module with `run` and `smooth`: `compiled`, or `reference` (filterpy). The log is filtered in blocks of
    `rows`, which changes nothing but the memory it takes.
    """
    check_log(log, log.path or "log")
    begin = opening(log)
    check_opening(log, begin)
    blocks = (log.table.iloc[start : start + rows] for start in range(0, len(log), rows))
    return States.of(log, pd.concat(filter_blocks(log, begin, blocks, engine), ignore_index=True))


def filter_file(
    log: str | Path, out: str | Path, tuned: Callable[[Vessel], Vessel] | None = None, rows: int = BLOCK
) -> tuple[Zone | None, np.ndarray]:
    """Filter a log file into the state file `out` (Parquet) in blocks of `rows`, so that memory does not grow with the log.

    The states are those of `filter_log`, of the vessel that `tuned` makes of the log's. The file is read twice, first to check
    it, so that nothing is written of a wrong one. Returns the zone, and latitude and longitude [rad] in the middle of the
    log (NaN where positions are local). Raises InputError for a wrong log.
    """
    head, count, blocks = records.read_blocks(log, rows)
    if tuned is not None:
        head = replace(head, vessel=tuned(head.vessel))
    begin: Opening | None = None
    place, seen = np.full(2, np.nan), 0
    for block in checks.check_blocks(head, count, blocks(), str(log)):
        part = opening(replace(head, table=block))
        begin = part if begin is None else joined(begin, part)
        if seen + len(block) > count // 2 and np.isnan(place).any():
            place = opening(replace(head, table=block.iloc[max(count // 2 - seen, 0) :])).place
        seen += len(block)
    assert begin is not None  # a log without rows has been refused
    check_opening(head, begin)
    records.write_state_blocks(States.of(head, head.table), filter_blocks(head, begin, blocks()), out)
    return head.zone, np.where(np.isnan(place), begin.place, place)


def smooth_log(log: Log, engine=compiled) -> States:
    """States of a log, each from the whole log: labels and reference paths, never inputs of a prediction.

    CAA is smoothed first; CTRA runs again on the smoothed heading and yaw rate, and is smoothed. Smoothing runs back from the
    end, so the whole log is in memory: a few kilobytes per row.
    """
    check_log(log, log.path or "log")
    m, vessel = from_log(log), log.vessel
    size = vessel.service_speed, vessel.length
    turn = heading_problem(m, vessel.noise, *size)
    heading: tuple[np.ndarray, np.ndarray] = engine.smooth(turn, engine.run(turn))
    motion = motion_problem(m, vessel.noise, heading[0], heading[1], size[0], size[1])
    moving = engine.run(motion)
    held = Held.before(opening(log), float(m.time[0]))
    columns, _ = estimates(log, m, heading, engine.smooth(motion, moving), moving, None, held)
    return States.of(log, pd.DataFrame(columns), smoothed=True)
