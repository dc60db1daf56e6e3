"""States and predictors for the tests of the live core: made up, so that every number is known beforehand."""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from aspnn import schema
from aspnn.frames import Zone, to_grid
from aspnn.motion import Path, Spread, integrate
from aspnn.motion.spread import disc, strip
from aspnn.records import States
from aspnn.vessel import load_vessel

ZONE = Zone(33)
NORTH, EAST = (float(x) for x in to_grid(np.radians(69.65), np.radians(18.96), ZONE))


def turning(until: float, surge: float = 6.0, sway: float = 0.0, rate: float = 0.0, step: float = 0.1) -> States:
    """States of cargo90 that keeps surge, sway and yaw rate from time 0 at (NORTH, EAST), heading grid north."""
    vessel = load_vessel("cargo90")
    count = round(until / step)
    path = integrate((NORTH, EAST, 0.0), np.tile([surge, sway, rate], (count, 1)), step)
    bow, stern = vessel.sway_stations
    known = {
        "time_s": path.time,
        "north_m": path.north,
        "east_m": path.east,
        "heading_rad": path.heading,
        "surge_m_s": surge,
        "sway_m_s": sway,
        "yaw_rate_rad_s": rate,
        "convergence_rad": 0.01,
        "sway_bow_m_s": sway + rate * bow,
        "sway_stern_m_s": sway + rate * stern,
        "rudder_order_rad": 0.1,
        "rudder_angle_rad": 0.09,
        "shaft_speed_rps": 2.0,
        "gated": False,
        "stale": False,
        "coasting": False,
    }
    table = {c.name: np.zeros(count + 1) for c in schema.STATES if c.needed}
    table = pd.DataFrame(table | {k: np.broadcast_to(v, count + 1) for k, v in known.items()})
    for name in table:
        if str(name).endswith("_sd"):
            table[name] = 0.1
    return States(table=table, vessel=vessel, zone=ZONE, start="2025-06-01T00:00:00Z", voyage="stand-in")


@dataclass(frozen=True)
class Straight:
    """Predicts that she runs straight on from where she is, `aside` [m] to the east of it, with a round region of `sd` [m] and `turn` [rad]."""

    aside: float = 0.0
    sd: float = 5.0
    turn: float = 0.01
    horizon: float = 90.0
    name: str = "straight"

    def predict(self, states: States, rudder_plan=None, shaft_plan=None) -> Path:
        return self.predict_many(states, np.array([len(states) - 1]), [None])[0]

    def predict_many(self, states: States, rows, plans) -> Path:
        n, steps = len(rows), int(self.horizon)
        now = [states[name][rows] for name in ("north_m", "east_m", "heading_rad")]
        velocity = np.zeros((n, steps, 3))
        velocity[..., 0] = states["surge_m_s"][rows][:, None]
        path = integrate(np.stack(now, axis=-1) + np.array([0, self.aside, 0]), velocity, 1.0)
        levels = np.array([0.5, 0.95])
        covariance = np.broadcast_to(np.diag([self.sd**2, self.sd**2, self.turn**2]), (n, steps + 1, 3, 3))
        spread = Spread(
            covariance,
            np.zeros(n, bool),
            levels,
            np.broadcast_to([disc(p) for p in levels], (n, steps + 1, 2)),
            np.broadcast_to([strip(p) for p in levels], (n, steps + 1, 2)),
            np.ones(n),
            3.0,
        )
        values = {
            k: getattr(path, k) for k in ("time", "north", "east", "heading", "surge", "sway", "yaw_rate", "pivot")
        }
        return Path(**values, convergence=states["convergence_rad"][rows], spread=spread)
