"""Voyages: batches of ships integrated under their helms, or under orders known beforehand."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from aspnn.angles import compass
from aspnn.frames import to_body
from aspnn.guidance.helms import COLUMNS, HEADING, RUDDER, SURGE, SWAY, YAW_RATE, Helm
from aspnn.schema import InputError
from aspnn.simulation.mmg import Ship, rates_of, run_batch, step_batch


@dataclass(frozen=True)
class Voyage:
    """The true motion of one simulated ship, arrays over time (steps + 1,) in SI and radians.

    `heading` from grid north, continuous. Velocities at midship are over ground; `surge_rate` and `sway_rate` are their time
    derivatives in body components. `order` is what the helm asks from that instant on. `current` and `wind` (2,) are the
    velocities [m/s] of water and air, north and east.
    """

    time: np.ndarray
    north: np.ndarray
    east: np.ndarray
    heading: np.ndarray
    surge: np.ndarray
    sway: np.ndarray
    yaw_rate: np.ndarray
    surge_rate: np.ndarray
    sway_rate: np.ndarray
    yaw_acceleration: np.ndarray
    rudder: np.ndarray
    order: np.ndarray
    shaft: np.ndarray
    current: np.ndarray
    wind: np.ndarray

    def truth(self) -> pd.DataFrame:
        """The voyage as a table with the columns of schema.TRUTH."""
        return pd.DataFrame(
            {
                "time_s": self.time,
                "north_m": self.north,
                "east_m": self.east,
                "heading_rad": self.heading,
                "surge_m_s": self.surge,
                "sway_m_s": self.sway,
                "yaw_rate_rad_s": self.yaw_rate,
                "rudder_angle_rad": self.rudder,
                "shaft_speed_rps": self.shaft,
                "current_north_m_s": self.current[0],
                "current_east_m_s": self.current[1],
                "wind_speed_true_m_s": np.hypot(*self.wind),
                "wind_from_grid_rad": compass(np.arctan2(0.0 - self.wind[1], 0.0 - self.wind[0])),
            }
        )


def start_states(north, east, heading, speed) -> np.ndarray:
    """Start states (batch, 7) of ships on a straight course with `speed` [m/s] through the water, rudder amidships."""
    states = np.zeros((*np.broadcast_shapes(*(np.shape(x) for x in (north, east, heading, speed))), COLUMNS))
    states[..., 0], states[..., 1], states[..., HEADING], states[..., SURGE] = north, east, heading, speed
    return np.atleast_2d(states)


def simulate(
    ship: Ship, helm: Helm, start: np.ndarray, duration: float, shaft, current=0.0, wind=0.0, dt: float = 0.1
) -> list[Voyage]:
    """Integrate a batch of ships under a helm that sees their states; one voyage per row of `start` (batch, 7).

    `duration` and `dt` in s; `shaft` [rev/s] a number or (batch,); `current` and `wind` the velocities [m/s] of water and air
    towards north and east, (2,) or (batch, 2). The helm is asked every `dt`; its order, held within the rudder's limit,
    holds until the next.
    """
    start = np.array(start, float)
    batch, steps = len(start), round(duration / dt)
    shaft = _filled(ship, "shaft speed", shaft, (batch,))
    current, wind = _environment(ship, current, wind, batch)
    states, orders = np.empty((steps + 1, batch, COLUMNS)), np.empty((steps + 1, batch))
    states[0] = start
    time = np.arange(steps + 1) * dt
    for k in range(steps + 1):
        orders[k] = helm(time[k], states[k])
        if k < steps:
            step_batch(
                *(ship.mmg, ship.air, ship.rudder_rate, ship.rudder_max),
                *(states[k], orders[k], shaft, current, wind, dt, states[k + 1]),
            )
    orders = np.clip(orders, -ship.rudder_max, ship.rudder_max)
    return [
        _voyage(ship, time, np.ascontiguousarray(states[:, b]), orders[:, b], shaft[b], current[b], wind[b])
        for b in range(batch)
    ]


def run_on(ship: Ship, start, orders, shaft, current=0.0, wind=0.0, dt: float = 0.1) -> np.ndarray:
    """Integrate a batch under rudder orders known beforehand, in one compiled call: states (batch, steps + 1, 7).

    `start` (batch, 7); `orders` [rad] (batch, steps), each held over its step of `dt` [s]; `shaft` [rev/s] a number, (batch, 1)
    or (batch, steps); `current` and `wind` as in `simulate`.
    """
    orders = np.ascontiguousarray(np.atleast_2d(orders), dtype=float)
    batch, steps = orders.shape
    shaft = _filled(ship, "shaft speed", shaft, (batch, steps))
    current, wind = _environment(ship, current, wind, batch)
    paths = np.empty((batch, steps + 1, COLUMNS))
    paths[:, 0] = start
    run_batch(ship.mmg, ship.air, ship.rudder_rate, ship.rudder_max, orders, shaft, current, wind, float(dt), paths)
    return paths


def _filled(ship: Ship, what: str, value, shape: Sequence[int]) -> np.ndarray:
    value = np.ascontiguousarray(np.broadcast_to(np.asarray(value, float), shape))
    if not np.all(value >= 0):
        raise InputError(
            f"vessel {ship.name}: a {what} of {np.min(value):g} cannot be simulated, the engine runs ahead"
        )
    return value


def _environment(ship: Ship, current, wind, batch: int) -> tuple[np.ndarray, np.ndarray]:
    current, wind = (np.ascontiguousarray(np.broadcast_to(np.asarray(x, float), (batch, 2))) for x in (current, wind))
    if np.any(wind) and ship.air.A_L == 0:
        raise InputError(f"vessel {ship.name}: has no section wind, so it cannot be simulated in wind")
    return current, wind


def _voyage(ship: Ship, time, states, order, shaft, current, wind) -> Voyage:
    """The voyage over ground: u_ground = u + current in body components, which turn at -r; so do their derivatives."""
    heading, yaw_rate = states[:, HEADING], states[:, YAW_RATE]
    shafts = np.full(len(time), shaft)
    rates = rates_of(ship.mmg, ship.air, states, shafts, current, wind)
    forward, starboard = to_body(current[0], current[1], heading)
    return Voyage(
        time=time,
        north=states[:, 0],
        east=states[:, 1],
        heading=heading,
        surge=states[:, SURGE] + forward,
        sway=states[:, SWAY] + starboard,
        yaw_rate=yaw_rate,
        surge_rate=rates[:, SURGE] + yaw_rate * starboard,
        sway_rate=rates[:, SWAY] - yaw_rate * forward,
        yaw_acceleration=rates[:, YAW_RATE],
        rudder=states[:, RUDDER],
        order=order,
        shaft=shafts,
        current=current,
        wind=wind,
    )
