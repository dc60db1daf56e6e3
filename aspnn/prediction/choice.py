"""The hybrid choice: the kinematic path where that is the better one, the learned path elsewhere, a mix in between.

The thesis ends by asking for it: kinematics serve while nothing changes, the network after orders. With w the share of the
kinematic path k and n the learned one, at every instant

    place = place_n + w (place_k - place_n),    heading = heading_n + w' (heading_k - heading_n)

so that no prediction is further off than the two are on average, |e| <= w |e_k| + (1 - w) |e_n|. Both paths begin in the same
pose, and so does the mix. Headings are continuous from there and their difference is that of two turns: it is not wrapped,
since a wrapped one would jump as one ship overtakes the other by half a turn. Velocities are those that the exact step
needs from pose to pose (E40), so the mix is the path of a rigid hull as its parts are.

No torch is imported here. Which shares serve best is measured in evaluation.choose.
"""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields, replace
from typing import Any

import numpy as np

from aspnn.motion import Path, pivot_point
from aspnn.motion.path import YAW_RATE_FLOOR
from aspnn.orders import Plan
from aspnn.prediction.kinematic import KinematicPredictor, Motion, caa_cmm, caa_ctra, constant
from aspnn.prediction.uncertainty import ORDER_SIZE, population
from aspnn.records import States
from aspnn.schema import InputError
from aspnn.vessel import Vessel

MOTIONS: dict[str, Motion] = {"caa_ctra": caa_ctra, "caa_cmm": caa_cmm, "constant": constant}
PHASES = ("steady", "order")
STEP = 0.1  # s, the longest step of the kinematic path


@dataclass(frozen=True)
class HybridChoice:
    """What is left to the kinematic path: shares between 0 and 1 by phase at `time` (knots,) [s], linear between.

    `kinematic` names the model (one of MOTIONS). `place` and `heading` map a phase to shares (knots,): `steady` over the time
    from the start while no order acts, `order` over the time from an order of at least 5 deg. An order up to `settled` [s] before
    the start counts as given at the start. `facts` say what it was fixed on.
    """

    kinematic: str
    time: np.ndarray
    place: dict[str, np.ndarray]
    heading: dict[str, np.ndarray]
    settled: float
    facts: dict[str, Any]

    @property
    def idle(self) -> bool:
        """Whether all is left to the network."""
        return not any(share.any() for share in (*self.place.values(), *self.heading.values()))

    def to_dict(self) -> dict[str, Any]:
        """Plain data for config.json."""
        tables = {key: {k: v.tolist() for k, v in getattr(self, key).items()} for key in ("place", "heading")}
        return asdict(self) | {"time": self.time.tolist()} | tables

    @staticmethod
    def from_dict(data: dict[str, Any], name: str) -> "HybridChoice":
        """The choice of checkpoint `name` from the plain data of its config. Raises InputError if it is damaged."""
        try:
            values = {field.name: data[field.name] for field in fields(HybridChoice)}
            values["time"] = np.array(data["time"], float)
            for key in ("place", "heading"):
                values[key] = {phase: np.array(data[key][phase], float) for phase in PHASES}
            found = HybridChoice(**values)
            if found.kinematic not in MOTIONS:
                raise ValueError(f"kinematic is {found.kinematic}, not one of {', '.join(MOTIONS)}")
            if not (np.diff(found.time) > 0).all():
                raise ValueError("time must rise")
            for share in (*found.place.values(), *found.heading.values()):
                if share.shape != found.time.shape or not ((share >= 0) & (share <= 1)).all():
                    raise ValueError("shares must be between 0 and 1, one for each time")
            if not found.settled >= 0:
                raise ValueError("settled must not be negative")
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise InputError(
                f"checkpoint {name}: config.json: choice is damaged ({error}); run `aspnn choose` again"
            ) from None
        return found

    def shares(self, since: np.ndarray, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Shares (n, steps) of the kinematic place and heading at `time` (steps,), for orders acting from `since` (n,) [s] on.

        Until an order yet to come the ship keeps what it has, afterwards at most that: a plan that is changed later is the
        same path until then.
        """
        since = np.asarray(since, float)[:, None]
        found = []
        for table in (self.place, self.heading):
            steady = np.broadcast_to(np.interp(time, self.time, table["steady"]), (len(since), len(time)))
            order = np.interp(time - since, self.time, table["order"])
            found.append(np.where(since <= 0, order, np.where(time < since, steady, np.minimum(steady, order))))
        return found[0], found[1]

    def mix(self, path: Path, vessel: Vessel, states: States, rows: np.ndarray, plans: Sequence[Plan]) -> Path:
        """The chosen paths (n, steps), from the learned ones (without spread) at `rows` of the states under `plans`.

        Where a path is all the network's it stays as it is, bit by bit.
        """
        rows = np.asarray(rows, int)
        since = [acting_from(states, int(row), plan, self.settled) for row, plan in zip(rows, plans, strict=True)]
        place, heading = self.shares(np.array(since), path.time)
        if not (place.any() or heading.any()):
            return path
        starts, of = np.unique(rows, return_inverse=True)  # the plans of a fan have one kinematic path
        period = float(path.time[1])
        motion = KinematicPredictor(
            vessel, MOTIONS[self.kinematic], float(path.time[-1]), period, period / math.ceil(period / STEP - 1e-9)
        )
        return mixed(path, motion.predict_many(states, starts, ())[of], place, heading)


def acting_from(states: States, row: int, plan: Plan, settled: float) -> float:
    """When an order begins to act [s from the start]: 0 for one now or in the last `settled` seconds, inf for none planned."""
    if population(states, row, plan, 0.0, settled) == "new_order":
        return 0.0
    far = np.abs(plan.rudder.values - plan.rudder.at(0.0)) >= ORDER_SIZE - 1e-9
    return float(plan.rudder.times[np.argmax(far)]) if far.any() else math.inf


def mixed(learned: Path, kinematic: Path, place: np.ndarray, heading: np.ndarray) -> Path:
    """The mix of two paths (n, steps) from the same pose, by the kinematic one's shares (n, steps) of place and heading.

    Over each step the velocities are those of the circular arc from pose to pose: with w the turn, D = dN + i dE and psi the
    heading before it, u + i v = D exp(-i (psi + w / 2)) / (dt sinc(w / 2)), the inverse of E40. The last point repeats the
    last step's. Steps without a share of the kinematic path are the learned path's own.
    """
    north = learned.north + place * (kinematic.north - learned.north)
    east = learned.east + place * (kinematic.east - learned.east)
    turned = learned.heading + heading * (kinematic.heading - learned.heading)
    dt, turn = np.diff(learned.time), np.diff(turned, axis=-1)
    step = np.diff(north, axis=-1) + 1j * np.diff(east, axis=-1)
    body = step * np.exp(-1j * (turned[..., :-1] + turn / 2)) / (dt * np.sinc(turn / (2 * np.pi)))
    touched = (place > 0) | (heading > 0)
    touched = touched[..., :-1] | touched[..., 1:]
    surge, sway, yaw_rate, touched = (
        np.concatenate([values, values[..., -1:]], axis=-1) for values in (body.real, body.imag, turn / dt, touched)
    )
    return replace(
        learned,
        north=north,
        east=east,
        heading=turned,
        surge=np.where(touched, surge, learned.surge),
        sway=np.where(touched, sway, learned.sway),
        yaw_rate=np.where(touched, yaw_rate, learned.yaw_rate),
        pivot=np.where(touched, pivot_point(sway, yaw_rate, YAW_RATE_FLOOR / 3), learned.pivot),
    )
