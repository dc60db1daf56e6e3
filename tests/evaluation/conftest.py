"""Voyages made by hand: a first-order (Nomoto) ship under given rudder orders, and predictors whose errors are known."""

import math
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
import pytest

from aspnn.evaluation.reference import Reference, Voyage
from aspnn.motion import Path, integrate
from aspnn.orders import Orders
from aspnn.records import States
from aspnn.schema import STATES
from aspnn.vessel import load_vessel


def table_of(time, order, motion=None) -> pd.DataFrame:
    """A states table with every needed column; `motion` fills north, east, heading, surge, sway, yaw rate."""
    table = pd.DataFrame({c.name: np.zeros(len(time)) for c in STATES if c.needed})
    table["time_s"], table["rudder_order_rad"], table["rudder_angle_rad"] = time, order, order
    for name in ("gated", "stale", "coasting"):
        table[name] = False
    for name, values in (motion or {}).items():
        table[name] = values
    return table


def nomoto_voyage(seed=0, duration=1500.0, noise=0.0, orders=None, vessel="cargo90", step=0.5) -> Voyage:
    """A voyage with truth: yaw rate follows 0.06 x order with a time constant of 12 s, sway is -25 m x yaw rate."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, duration + 1e-9, step)
    if orders is None:
        times = np.cumsum(np.concatenate([[0.0], rng.uniform(60, 240, 20)])) // step * step
        orders = Orders(times, np.radians(5.0) * rng.integers(-4, 5, len(times)))
    order = orders.at(time)
    yaw_rate = np.zeros(len(time))
    for k in range(1, len(time)):
        yaw_rate[k] = yaw_rate[k - 1] + step / 12 * (0.06 * order[k - 1] - yaw_rate[k - 1])
    body = np.stack([6.0 - 200 * yaw_rate**2 / 0.02, -25 * yaw_rate, yaw_rate], axis=-1)
    path = integrate((7.2e6, 4.1e5, 0.4), body[:-1], step)
    motion = {
        "north_m": path.north, "east_m": path.east, "heading_rad": path.heading,
        "surge_m_s": body[:, 0], "sway_m_s": body[:, 1], "yaw_rate_rad_s": body[:, 2],
    }  # fmt: skip
    zero = np.zeros(len(time))
    columns = ("shaft_speed_rps", "current_north_m_s", "current_east_m_s", "wind_speed_true_m_s", "wind_from_grid_rad")
    truth = pd.DataFrame({"time_s": time, **motion, "rudder_angle_rad": order, **dict.fromkeys(columns, zero)})
    noisy = {name: values + noise * rng.normal(size=len(time)) for name, values in motion.items() if name[-2:] == "_m"}
    states = States(table_of(time, order, motion | noisy), load_vessel(vessel), voyage=f"voyage-{seed}")
    return Voyage(states, Reference.of_truth(truth), truth, name=f"voyage-{seed}.parquet")


@dataclass(frozen=True)
class Held:
    """Constant surge, sway and yaw rate, and nothing of the plan."""

    name: str = "constant"
    horizon: float = 90.0

    def predict_many(self, states, rows, plans) -> Path:
        pose = np.stack([states[c][rows] for c in ("north_m", "east_m", "heading_rad")], axis=-1)
        body = np.stack([states[c][rows] for c in ("surge_m_s", "sway_m_s", "yaw_rate_rad_s")], axis=-1)
        steps = round(self.horizon / 0.5)
        return integrate(pose, np.repeat(body[:, None], steps, axis=1), 0.5)


@dataclass(frozen=True)
class Cheat:
    """The reference itself, moved by north, east [m] and turned by [rad] after the start."""

    reference: Reference
    north: float = 0.0
    east: float = 0.0
    turn: float = 0.0
    name: str = "cheat"

    def predict_many(self, states, rows, plans) -> Path:
        path = self.reference.path(states["time_s"][rows], np.arange(0, 90.1, 0.5))
        return replace(
            path, north=path.north + self.north, east=path.east + self.east, heading=path.heading + self.turn
        )


@dataclass(frozen=True)
class Planner:
    """Knows the Nomoto ship but for a time constant wrong by `slack` [s]: a decent predictor that uses the plan."""

    name: str = "nomoto"
    slack: float = 0.0
    horizon: float = 90.0

    def predict_many(self, states, rows, plans) -> Path:
        steps, step = round(self.horizon / 0.5), 0.5
        time = np.arange(steps) * step
        order = np.stack([plan.rudder.at(time) for plan in plans])
        pose = np.stack([states[c][rows] for c in ("north_m", "east_m", "heading_rad")], axis=-1)
        rate = np.empty((len(rows), steps))
        rate[:, 0] = states["yaw_rate_rad_s"][rows]
        for k in range(1, steps):
            rate[:, k] = rate[:, k - 1] + step / (12 + self.slack) * (0.06 * order[:, k - 1] - rate[:, k - 1])
        return integrate(pose, np.stack([6.0 - 200 * rate**2 / 0.02, -25 * rate, rate], axis=-1), step)


def degrees(*values):
    return np.array([math.radians(value) for value in values])


@pytest.fixture(scope="session")
def voyages() -> list[Voyage]:
    return [nomoto_voyage(seed, noise=0.3) for seed in range(4)]
