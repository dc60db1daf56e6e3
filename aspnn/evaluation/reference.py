"""What predictions are measured against: the true path at midship where it exists, else the smoothed one."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path as FilePath

import numpy as np
import pandas as pd

from aspnn import records
from aspnn.motion import Path, pivot_point
from aspnn.motion.path import YAW_RATE_FLOOR
from aspnn.orders import Orders
from aspnn.records import Log, States
from aspnn.schema import InputError

TRUTH, SMOOTHED = "truth", "smoothed"


@dataclass(frozen=True)
class Reference:
    """The motion of midship during a voyage, arrays (rows,) in SI, heading [rad] continuous from grid north.

    `kind` is `truth` (simulated voyages) or `smoothed`. `coasting` marks rows where nothing was measured.
    """

    kind: str
    time: np.ndarray
    north: np.ndarray
    east: np.ndarray
    heading: np.ndarray
    surge: np.ndarray
    sway: np.ndarray
    yaw_rate: np.ndarray
    coasting: np.ndarray

    @staticmethod
    def of_truth(truth: pd.DataFrame) -> "Reference":
        """The reference of a simulated voyage, from its truth table (schema.TRUTH)."""
        return Reference._of(TRUTH, truth, np.zeros(len(truth), bool))

    @staticmethod
    def of_states(smoothed: States) -> "Reference":
        """The reference of a recorded voyage, from its smoothed states."""
        if not smoothed.smoothed:
            raise InputError(
                f"{smoothed.path or smoothed.voyage}: filtered states are no reference; smooth the log (`smooth_log`)"
            )
        return Reference._of(SMOOTHED, smoothed.table, smoothed["coasting"] != 0)

    @staticmethod
    def _of(kind: str, table: pd.DataFrame, coasting: np.ndarray) -> "Reference":
        time, north, east, heading, surge, sway, yaw_rate = (table[name].to_numpy(float) for name in _COLUMNS)
        return Reference(kind, time, north, east, np.unwrap(heading), surge, sway, yaw_rate, coasting)

    def known(self, start: np.ndarray, horizon: float) -> np.ndarray:
        """Whether the reference covers `horizon` [s] from each of `start` [s] and never coasts there. Shape of start."""
        begin = np.searchsorted(self.time, start + 1e-6, side="right") - 1
        end = np.searchsorted(self.time, start + horizon - 1e-6, side="left")
        covered = (begin >= 0) & (end < len(self.time))
        coasted = np.concatenate([[0], np.cumsum(self.coasting)])
        begin, end = np.clip(begin, 0, None), np.clip(end, None, len(self.time) - 1)
        return covered & (coasted[end + 1] == coasted[begin])

    def path(self, start: np.ndarray, time: np.ndarray) -> Path:
        """The path from each of `start` [s] (n,) at `time` [s] from there (steps,): arrays (n, steps), linear between rows."""
        at = np.asarray(start, float)[:, None] + np.asarray(time, float)
        north, east, heading, surge, sway, yaw_rate = (
            np.interp(at, self.time, values)
            for values in (self.north, self.east, self.heading, self.surge, self.sway, self.yaw_rate)
        )
        pivot = pivot_point(sway, yaw_rate, YAW_RATE_FLOOR / 3)
        return Path(np.asarray(time, float), north, east, heading, surge, sway, yaw_rate, pivot)


_COLUMNS = ("time_s", "north_m", "east_m", "heading_rad", "surge_m_s", "sway_m_s", "yaw_rate_rad_s")


@dataclass(frozen=True)
class Voyage:
    """One voyage to be evaluated: filtered states (what predictors may see), reference, and the truth if there is one.

    `shaft` holds the engine orders of the log, if it has them.
    """

    states: States
    reference: Reference
    truth: pd.DataFrame | None = None
    shaft: Orders | None = None
    name: str = ""
    sha256: str = ""

    @staticmethod
    def of(log: Log, states: States, smooth: Callable[[Log], States]) -> "Voyage":
        """The voyage of a log and its filtered states; it is smoothed only where no truth lies beside the log."""
        if states.smoothed:
            raise InputError(f"{log.path or log.voyage}: smoothed states know the future; evaluate on filtered states")
        truth = records.read_truth(log)
        reference = Reference.of_states(smooth(log)) if truth is None else Reference.of_truth(truth)
        shaft = None
        if "engine_order_rps" in log.table and log.table["engine_order_rps"].notna().any():
            shaft = Orders.from_series(log.table["time_s"], log.table["engine_order_rps"])
        file = FilePath(log.path) if log.path else None
        name = file.name if file else log.voyage
        return Voyage(states, reference, truth, shaft, name, records.sha256(file) if file and file.exists() else "")
