"""Voyages: batches of ships integrated under their helms, or under orders known beforehand."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from aspnn.angles import compass
from aspnn.guidance import helms
from aspnn.guidance.helms import Helm
from aspnn.orders import Orders
from aspnn.simulation.actuators import delay_steps, heard, within_stops
from aspnn.simulation.environment.waves import Hull, motions
from aspnn.simulation.integrate import Water, current_along, rates_of, run_batch
from aspnn.simulation.motion import Motion, over_ground, with_waves
from aspnn.simulation.sea import Sea
from aspnn.simulation.ship import Ship

Ordered = Helm | Sequence[Orders] | np.ndarray | float


@dataclass(frozen=True)
class Voyage:
    """The true motion of one simulated ship, arrays over time (steps + 1,) in SI and radians.

    `heading` from grid north, continuous. Velocities at midship are over ground and level: those of a ship that rolls and pitches
    are along its heading and athwart it; `surge_rate` and `sway_rate` are their time derivatives. `heave` is how far midship is below
    its place at rest, `pitch` positive bow up. `order`, `shaft_order` and `pitch_order` are what is asked from that instant on.
    `pitch_ratio` is NaN for a propeller of fixed pitch. `current` and `wind` (steps + 1, 2) are the velocities [m/s] of water and
    air towards north and east, `depth` [m] that of the water, `out_of_domain` the bits of `Ship.outside`.
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
    roll: np.ndarray
    pitch: np.ndarray
    heave: np.ndarray
    roll_rate: np.ndarray
    pitch_rate: np.ndarray
    heave_rate: np.ndarray
    heave_acceleration: np.ndarray
    rudder: np.ndarray
    order: np.ndarray
    shaft: np.ndarray
    shaft_order: np.ndarray
    pitch_ratio: np.ndarray
    pitch_order: np.ndarray
    current: np.ndarray
    wind: np.ndarray
    out_of_domain: np.ndarray
    depth: float = math.inf

    @staticmethod
    def level(
        time, north, east, heading, surge, sway, yaw_rate, surge_rate, sway_rate, yaw_acceleration, rudder, shaft
    ) -> "Voyage":
        """A voyage known by its horizontal motion alone: neither roll, pitch nor heave, no current, no wind, fixed pitch."""
        still, calm, unknown = np.zeros(len(time)), np.zeros((len(time), 2)), np.full(len(time), np.nan)
        horizontal = north, east, heading, surge, sway, yaw_rate, surge_rate, sway_rate, yaw_acceleration
        motion = Motion(*horizontal, *[still] * 7)
        return Voyage(
            time,
            *motion,
            rudder,
            order=rudder,
            shaft=shaft,
            shaft_order=shaft,
            pitch_ratio=unknown,
            pitch_order=unknown,
            current=calm,
            wind=calm,
            out_of_domain=np.zeros(len(time), int),
        )

    def truth(self) -> pd.DataFrame:
        """The voyage as a table with the columns of schema.TRUTH; those of attitude, pitch and domain only where they are not 0."""
        table = {
            "time_s": self.time,
            "north_m": self.north,
            "east_m": self.east,
            "heading_rad": self.heading,
            "surge_m_s": self.surge,
            "sway_m_s": self.sway,
            "yaw_rate_rad_s": self.yaw_rate,
            "rudder_angle_rad": self.rudder,
            "shaft_speed_rps": self.shaft,
            "current_north_m_s": self.current[:, 0],
            "current_east_m_s": self.current[:, 1],
            "wind_speed_true_m_s": np.hypot(self.wind[:, 0], self.wind[:, 1]),
            "wind_from_grid_rad": compass(np.arctan2(0.0 - self.wind[:, 1], 0.0 - self.wind[:, 0])),
        }
        if np.isfinite(self.pitch_ratio).any():
            table["propeller_pitch_ratio"] = self.pitch_ratio
        attitude = {"roll_rad": self.roll, "pitch_rad": self.pitch, "heave_m": self.heave}
        if any(values.any() for values in attitude.values()):
            table |= attitude
        if self.out_of_domain.any():
            table["out_of_domain"] = self.out_of_domain
        return pd.DataFrame(table)


def simulate(
    ship: Ship,
    helm: Ordered,
    start: np.ndarray,
    duration: float,
    shaft: Ordered | None = None,
    pitch: Ordered | None = None,
    sea: Sea | None = None,
    dt: float = 0.1,
) -> list[Voyage]:
    """Integrate a batch of ships under a helm that sees their states; one voyage per row of `start` (batch, columns).

    `duration` and `dt` in s. `helm`, `shaft` [rev/s] and `pitch` ratio are a callable (time, states) -> orders (batch,), asked
    every `dt`, or what is known beforehand: Orders for each ship (or one for all), one number or (batch,). Shaft and
    pitch that are not told stay as the start has them. Where all is known, all steps are one compiled call. Raises
    InputError for an order beyond the stops.
    """
    start = np.atleast_2d(np.array(start, float))
    batch, steps = len(start), round(duration / dt)
    sea = sea or Sea()
    water = sea.around(ship, batch)
    time = np.arange(steps + 1) * dt
    servos = ship.rudder, ship.shaft, ship.pitch
    given = [helm, start[:, helms.SHAFT] if shaft is None else shaft]
    given.append(start[:, helms.PITCH_RATIO] if pitch is None else pitch)
    paths, orders = np.empty((batch, steps + 1, ship.columns)), np.empty((batch, steps + 1, 3))
    paths[:, 0] = start
    for i, order in enumerate(given):
        if not callable(order):
            orders[..., i] = _series(order, time, batch)
    asked = [(i, order) for i, order in enumerate(given) if callable(order)]
    if asked:
        late = [delay_steps(servo, dt) for servo in servos]
        for k in range(steps + 1):
            for i, lever in asked:
                orders[:, k, i] = lever(time[k], paths[:, k])
            if k < steps:
                now = [orders[:, k - n, i] if k >= n else start[:, helms.RUDDER + i] for i, n in enumerate(late)]
                two = np.stack([paths[:, k], paths[:, k]], axis=1)
                run_batch(ship.compiled, water, k, np.stack(now, axis=-1)[:, None], dt, two)
                paths[:, k + 1] = two[:, 1]
    else:
        told = [heard(servo, orders[:, :-1, i], start[:, helms.RUDDER + i], dt) for i, servo in enumerate(servos)]
        run_batch(ship.compiled, water, 0, np.stack(told, axis=-1), float(dt), paths)
    _within(ship, orders)
    waves = sea.first_order(ship, batch)
    return [_voyage(ship, time, paths[b], orders[b], water, b, dt, waves[b]) for b in range(batch)]


def _series(order, time: np.ndarray, batch: int) -> np.ndarray:
    """Orders known beforehand as (batch, steps + 1)."""
    if isinstance(order, Sequence) and isinstance(order[0], Orders):
        rows = np.stack([one.at(time) for one in order])
        return np.broadcast_to(rows, (batch, len(time)))
    return np.broadcast_to(np.reshape(np.asarray(order, float), (-1, 1)), (batch, len(time)))


def run_on(ship: Ship, start, orders, shaft=None, pitch=None, sea: Sea | None = None, dt: float = 0.1) -> np.ndarray:
    """Integrate a batch under orders known beforehand, in one compiled call: states (batch, steps + 1, columns).

    `start` (batch, columns); rudder `orders` [rad] (batch, steps), each held over its step of `dt` [s]; `shaft` [rev/s] and
    `pitch` ratio a number, (batch, 1) or (batch, steps), without them as the start has them. Raises InputError as `simulate`.
    """
    start = np.atleast_2d(np.asarray(start, float))
    orders = np.atleast_2d(np.asarray(orders, float))
    shape = orders.shape
    given = [orders, start[:, helms.SHAFT, None] if shaft is None else shaft]
    given.append(start[:, helms.PITCH_RATIO, None] if pitch is None else pitch)
    told = np.stack([np.broadcast_to(np.asarray(one, float), shape) for one in given], axis=-1)
    _within(ship, told)
    told = np.ascontiguousarray(told)
    for i, servo in enumerate((ship.rudder, ship.shaft, ship.pitch)):
        told[..., i] = heard(servo, told[..., i], start[:, helms.RUDDER + i], dt)
    paths = np.empty((shape[0], shape[1] + 1, ship.columns))
    paths[:, 0] = start
    run_batch(ship.compiled, (sea or Sea()).around(ship, shape[0]), 0, told, float(dt), paths)
    return paths


def _within(ship: Ship, orders: np.ndarray) -> None:
    within_stops(ship.rudder, orders[..., 0], f"{ship.vessel.label}: a rudder order [rad]")
    within_stops(ship.shaft, orders[..., 1], f"{ship.vessel.label}: a shaft order [rev/s]")
    pitch = orders[..., 2]
    within_stops(ship.pitch, pitch[np.isfinite(pitch)], f"{ship.vessel.label}: an order of the pitch ratio")


def _voyage(ship: Ship, time, states, orders, water: Water, b: int, dt: float, waves) -> Voyage:
    rates = rates_of(ship.compiled, water, b, dt, states)
    if water.eddies.shape[1] > 0:
        current = current_along(water.current[b], water.eddies[b], states, dt)
        current_rate = np.gradient(current, dt, axis=0)
    else:
        current, current_rate = np.broadcast_to(water.current[b], (len(time), 2)), np.zeros((len(time), 2))
    motion = over_ground(states, rates, current, current_rate)
    if waves is not None:
        moved = motions(waves, Hull.of(ship.vessel), motion.north, motion.east, motion.heading, motion.surge, time)
        motion = with_waves(motion, moved, time)
    return Voyage(
        time=time,
        **motion._asdict(),
        rudder=states[:, helms.RUDDER],
        order=orders[:, 0],
        shaft=states[:, helms.SHAFT],
        shaft_order=orders[:, 1],
        pitch_ratio=states[:, helms.PITCH_RATIO],
        pitch_order=orders[:, 2],
        current=current,
        wind=water.wind[b, np.minimum(np.arange(len(time)), water.wind.shape[1] - 1)],
        out_of_domain=ship.outside(states),
        depth=ship.depth,
    )
