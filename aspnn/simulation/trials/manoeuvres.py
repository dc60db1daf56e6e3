"""Manoeuvring trials: turning circle, zigzag, Williamson turn, pull-out, spiral and stop, run in calm and deep water.

Each trial runs all its sides and angles as one batch from a steady straight approach, at the shaft speed that holds the test
speed. The criteria and their definitions are those of MSC.137(76); pull-out and spiral follow appendix 4 of MSC/Circ.1053.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from aspnn.guidance import helms
from aspnn.guidance.helms import Helm
from aspnn.orders import Orders
from aspnn.schema import InputError
from aspnn.simulation.ship import ASTERN, BACKING, DRIFT, YAW
from aspnn.simulation.trials import standards
from aspnn.simulation.trials.indices import (
    Index,
    Return,
    Spiral,
    SteadyTurn,
    Stop,
    TurningCircle,
    Zigzag,
    return_indices,
    spiral_loop,
    steady_turn,
    stopping_indices,
    turning_circle_indices,
    turning_times,
    zigzag_indices,
)
from aspnn.simulation.trials.setting import COARSE, Setting
from aspnn.simulation.voyage import Voyage
from aspnn.vessel import Vessel

LONGEST = 480  # a trial that has not ended after so many L / V never will
PATIENCE = 120  # a spiral waits as many L / V at an angle and no longer
STEADY = 1e-4  # a yaw rate r L / V that changes by less in a tenth of the time is steady
AGREE = 0.02  # of the steady yaw rates of both turns: within that, the residual ones of a pull-out agree
SIDES = ("starboard", "port")
WORDS = {ASTERN: "sternway", DRIFT: "drift angle", YAW: "yaw rate", BACKING: "propeller astern"}


class Run(NamedTuple):
    """One ship of the batch: its test (as 10/10) and side where there are several, what it did, and what was found."""

    test: str
    side: str
    voyage: Voyage
    found: TurningCircle | Zigzag | Return | SteadyTurn | Spiral | Stop
    indices: tuple[Index, ...]


@dataclass(frozen=True)
class Trial:
    """A trial and its runs. `indices` are those of all runs together; `rudder` [rad] is the largest order, 0 in a stop."""

    kind: str
    setting: Setting
    rudder: float
    runs: tuple[Run, ...]
    indices: tuple[Index, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def verdicts(self) -> list[bool]:
        """Pass or fail of every index that has a criterion."""
        rows = [row for run in self.runs for row in run.indices] + list(self.indices)
        return [row.verdict for row in rows if row.verdict is not None]


def beside(many: Sequence[Helm]) -> Helm:
    """One helm for a batch whose ship i is steered by the i-th of `many`."""

    def helm(time: float, state: np.ndarray) -> np.ndarray:
        return np.concatenate([one(time, state[i : i + 1]) for i, one in enumerate(many)])

    return helm


def _steady(rates: np.ndarray, unit: float) -> bool:
    """Whether yaw rates [rad/s] no longer change: by less than STEADY / (L / V) in their last tenth."""
    return bool(abs(rates[-1] - rates[-1 - len(rates) // 10]) * unit < STEADY)


def _notes(setting: Setting, voyages: Sequence[Voyage], judged: bool) -> tuple[str, ...]:
    """Reservations about the criteria where there are any, and what of the trial was beyond the data of the model."""
    notes = standards.reservations(setting.length, setting.speed, setting.ship.service_speed) if judged else []
    bits = int(np.bitwise_or.reduce(np.concatenate([v.out_of_domain for v in voyages])))
    beyond = [word for bit, word in WORDS.items() if bits & bit]
    if beyond:
        notes.append(f"In part beyond the data of the model: {', '.join(beyond)}.")
    return tuple(notes)


def turning_circle(vessel: Vessel, rudder: float | None = None, speed: float | None = None) -> Trial:
    """Turning circles to both sides with `rudder` [rad] (35 degrees, or the stop) from `speed` [m/s] (in service)."""
    setting = Setting.of(vessel, speed)
    order = setting.rudder(rudder, standards.RUDDER)
    full = order > min(standards.RUDDER, setting.ship.rudder.most) - 1e-6
    lengths = 60
    voyages = setting.run(np.array([order, -order]), 2, lengths)
    while min(abs(v.heading[-1]) for v in voyages) < 3 * np.pi and lengths < LONGEST:
        lengths *= 2
        voyages = setting.run(np.array([order, -order]), 2, lengths)
    runs = tuple(_turn(setting, side, voyage, full) for side, voyage in zip(SIDES, voyages, strict=True))
    return Trial("turning-circle", setting, order, runs, notes=_notes(setting, voyages, full))


def _turn(setting: Setting, side: str, v: Voyage, full: bool) -> Run:
    circle = turning_circle_indices(v.time, v.north, v.east, v.heading)
    steady = steady_turn(v.surge[-1], v.sway[-1], v.yaw_rate[-1])
    times = turning_times(v.time, v.heading, np.pi * np.array([0.5, 1.0, 2.0]))
    limits = (standards.ADVANCE, standards.TACTICAL_DIAMETER) if full else (math.nan, math.nan)
    rows = (
        Index("advance", "advance", circle.advance, "m", limits[0] * setting.length),
        Index("transfer", "transfer", circle.transfer, "m"),
        Index("tactical_diameter", "tactical diameter", circle.tactical_diameter, "m", limits[1] * setting.length),
        Index("final_diameter", "final diameter", steady.diameter, "m"),
        Index("speed_ratio", "final speed / V", steady.speed / setting.speed, ""),
        Index("drift", "final drift angle", steady.drift, "rad"),
        Index("yaw_rate", "final yaw rate", steady.yaw_rate, "rad/s"),
        Index("pivot", "pivot point forward of midship", steady.pivot, "m"),
        *(Index(f"time_{a}", f"time to {a} deg", float(t), "s") for a, t in zip((90, 180, 360), times, strict=True)),
    )
    return Run("", side, v, circle, rows)


def zigzag(vessel: Vessel, rudder: float | None = None, speed: float | None = None) -> Trial:
    """Zigzags begun to both sides, 10/10 and 20/20, or with `rudder` [rad] and reversed at that heading, from `speed` [m/s]."""
    setting = Setting.of(vessel, speed)
    usual = [math.radians(a) for a in (10, 20)]
    angles = (
        [setting.rudder(rudder, usual[0])]
        if rudder is not None
        else [a for a in usual if a <= setting.ship.rudder.most + 1e-9]
    )
    if not angles:
        raise InputError(
            f"{vessel.label}: its rudder stops at {math.degrees(setting.ship.rudder.most):g} deg, before the 10 deg of the"
            f" standard zigzag; give --rudder"
        )
    orders = [sign * angle for angle in angles for sign in (1, -1)]
    helm = beside([helms.zigzag(order, abs(order)) for order in orders])
    lengths = 25
    voyages = setting.run(helm, len(orders), lengths)
    while min(_executes(v) for v in voyages) < 5 and lengths < 200:
        lengths *= 2
        voyages = setting.run(helm, len(orders), lengths)
    runs = tuple(_zigzag(setting, order, voyage) for order, voyage in zip(orders, voyages, strict=True))
    judged = any(math.isfinite(row.limit) for run in runs for row in run.indices)
    return Trial("zigzag", setting, max(angles), runs, notes=_notes(setting, voyages, judged))


def _executes(v: Voyage) -> int:
    return 1 + int(np.count_nonzero(np.diff(np.sign(v.order))))


def _zigzag(setting: Setting, order: float, v: Voyage) -> Run:
    angle = abs(order)
    found = zigzag_indices(v.time, v.north, v.east, v.heading, v.order, angle)
    first, second = (float(found.overshoots[i]) if len(found.overshoots) > i else math.nan for i in (0, 1))
    ten, twenty = (abs(angle - math.radians(a)) < 1e-6 for a in (10, 20))
    limits = [math.nan, math.nan]
    if ten:
        limits = [standards.first_overshoot(setting.unit), standards.second_overshoot(setting.unit)]
    elif twenty:
        limits[0] = standards.FIRST_OVERSHOOT_20
    check = found.peaks[0] - found.executes[1] if len(found.peaks) else math.nan
    rows = (
        Index("first_overshoot", "first overshoot", first, "rad", limits[0]),
        Index("second_overshoot", "second overshoot", second, "rad", limits[1]),
        Index(
            "initial_turning",
            "initial turning, track reach",
            found.initial_track,
            "m",
            standards.INITIAL_TURNING * setting.length if ten else math.nan,
        ),
        Index("initial_time", "time to second execute", found.initial_time, "s"),
        Index("check_time", "time to check yaw", float(check), "s"),
        Index("period", "period of yaw", float(found.period), "s"),
    )
    degrees = f"{math.degrees(angle):g}"
    return Run(f"{degrees}/{degrees}", SIDES[order < 0], v, found, rows)


def williamson(vessel: Vessel, rudder: float | None = None, speed: float | None = None) -> Trial:
    """Williamson turns to both sides with `rudder` [rad] (35 degrees, or the stop) from `speed` [m/s]."""
    setting = Setting.of(vessel, speed)
    order = setting.rudder(rudder, standards.RUDDER)
    helm = beside([helms.williamson_turn(side * order, lead=1.4 * setting.unit) for side in (1, -1)])
    voyages = setting.run(helm, 2, 40)
    return Trial(
        "williamson",
        setting,
        order,
        tuple(_return(side, voyage) for side, voyage in zip(SIDES, voyages, strict=True)),
        notes=_notes(setting, voyages, False),
    )


def _return(side: str, v: Voyage) -> Run:
    found = return_indices(v.time, v.north, v.east, v.heading)
    rows = (
        Index("time", "time to the reciprocal course", found.time, "s"),
        Index("offset", "distance from the old track there", abs(found.offset), "m"),
        Index("heading_error", "heading error at the end", found.heading_error, "rad"),
        Index("abeam_time", "time to abeam of the start", found.abeam_time, "s"),
        Index("abeam_offset", "distance from the start there", abs(found.abeam_offset), "m"),
    )
    return Run("", side, v, found, rows)


def pull_out(vessel: Vessel, rudder: float | None = None, speed: float | None = None) -> Trial:
    """Pull-outs from steady turns to both sides with `rudder` [rad] (20 degrees, or the stop) from `speed` [m/s].

    A course-stable ship's yaw rate comes to the same value from both sides, near zero; an unstable one's keeps its side.
    """
    setting = Setting.of(vessel, speed)
    order, hold = setting.rudder(rudder, math.radians(20)), 60
    voyages = _pulled(setting, order, hold)
    while not all(_steady(v.yaw_rate[len(v.time) // 2 :], setting.unit) for v in voyages) and hold < LONGEST:
        hold *= 2
        voyages = _pulled(setting, order, hold)
    released = len(voyages[0].time) // 2
    turns = [v.yaw_rate[released] for v in voyages]
    left = [v.yaw_rate[-1] for v in voyages]
    runs = []
    for side, voyage, rate in zip(SIDES, voyages, turns, strict=True):
        final = steady_turn(voyage.surge[-1], voyage.sway[-1], voyage.yaw_rate[-1])
        rows = (
            Index("turn", "yaw rate in the turn", float(rate), "rad/s"),
            Index("residual", "residual yaw rate", final.yaw_rate, "rad/s"),
            Index("residual_ratio", "residual / in the turn", float(final.yaw_rate / rate), ""),
        )
        runs.append(Run("", side, voyage, final, rows))
    gap = abs(left[0] - left[1])
    stable = gap <= AGREE * abs(turns[0] - turns[1])
    joint = (Index("difference", "difference of the residual yaw rates", float(gap), "rad/s"),)
    word = (
        "course-stable: the yaw rate comes to the same from both sides"
        if stable
        else "not course-stable: a yaw rate remains"
    )
    notes = (f"The ship is {word}.", *_notes(setting, voyages, False))
    return Trial("pull-out", setting, order, tuple(runs), joint, notes)


def _pulled(setting: Setting, order: float, hold: int) -> list[Voyage]:
    """Turns and pull-outs of `hold` lengths each, to starboard and to port."""
    orders = [helms.pull_out_orders(side * order, hold * setting.unit) for side in (1, -1)]
    return setting.run(orders, 2, 2 * hold, COARSE)


def spiral(vessel: Vessel, rudder: float | None = None, speed: float | None = None) -> Trial:
    """Dieudonne's direct spiral within `rudder` [rad] (15 degrees, or the stop) to both sides, from `speed` [m/s].

    Thirty angles to a side, closest amidships, where loops are; each is held until the yaw rate is steady.
    """
    setting = Setting.of(vessel, speed)
    order, hold = setting.rudder(rudder, math.radians(15)), 30
    orders, voyage, held = _spiralled(setting, order, hold)
    while not all(_steady(rates, setting.unit) for rates in held) and hold < PATIENCE:
        hold *= 2
        orders, voyage, held = _spiralled(setting, order, hold)
    turning, count = held[:, -1], len(orders.times) // 2
    unsteady = sum(not _steady(rates, setting.unit) for rates in held)
    found = spiral_loop(orders.values[count:], turning[count::-1], turning[count:])
    rows: tuple[Index, ...] = (
        Index("loop_width", f"width of the loop, known to {math.degrees(found.known):.1g} deg", found.width, "rad"),
        Index("loop_height", "height of the loop amidships", found.height, "rad/s"),
    )
    if math.isfinite(found.slope):
        rows = (*rows, Index("slope", "slope K' amidships, dr'/d(delta)", found.slope * setting.unit, ""))
    word = "not course-stable: the two ways differ" if found.width > 0 else "course-stable: the two ways are one curve"
    notes = [f"The ship is {word}."]
    if unsteady:
        notes.append(f"At {unsteady} of {len(held)} angles the yaw rate was not yet steady.")
    return Trial(
        "spiral",
        setting,
        order,
        (Run("", "", voyage, found, rows),),
        notes=(*notes, *_notes(setting, [voyage], False)),
    )


def _spiralled(setting: Setting, order: float, hold: int) -> tuple[Orders, Voyage, np.ndarray]:
    """A spiral that holds each angle for `hold` lengths: its orders, the voyage, and the yaw rates (angles, steps) of each."""
    each = round(hold * setting.unit / setting.step(COARSE))
    side = np.linspace(-1, 1, 61)
    orders = helms.spiral_orders(order * (0.2 * side + 0.8 * side**3), each * setting.step(COARSE))
    lengths = len(orders.times) * each * setting.step(COARSE) / setting.unit
    voyage = setting.run([orders], 1, lengths, COARSE)[0]
    return orders, voyage, voyage.yaw_rate[1:].reshape(len(orders.times), each)


def stopping(vessel: Vessel, rudder: float | None = None, speed: float | None = None) -> Trial:
    """Full astern stop from `speed` [m/s], rudder amidships: shaft at its most astern, or the pitch where that can be turned."""
    setting = Setting.of(vessel, speed)
    if rudder is not None:
        raise InputError(f"{vessel.label}: the stopping trial keeps the rudder amidships; leave --rudder out")
    turned = math.isfinite(setting.ship.pitch.least)
    shaft, pitch = (None, setting.ship.pitch.least) if turned else (setting.ship.shaft.least, None)
    if (setting.ship.pitch.least if turned else setting.ship.shaft.least) >= 0:
        raise InputError(
            f"{vessel.label}: has no drive astern ({'pitch.least' if turned else 'engine.least_rps'} is 0); it cannot be stopped"
        )
    lengths = 30
    v = setting.run(np.zeros(1), 1, lengths, shaft=shaft, pitch=pitch)[0]
    while v.surge.min() > 0 and lengths < LONGEST:
        lengths *= 2
        v = setting.run(np.zeros(1), 1, lengths, shaft=shaft, pitch=pitch)[0]
    found = stopping_indices(v.time, v.north, v.east, v.heading, v.surge)
    rows = (
        Index(
            "track_reach", "track reach", found.track_reach, "m", standards.TRACK_REACH * setting.length, judged=False
        ),
        Index("head_reach", "head reach", found.head_reach, "m"),
        Index("side_reach", "side reach, to starboard", found.side_reach, "m"),
        Index("heading_change", "heading change", found.heading_change, "rad"),
        Index("time", "time", found.time, "s"),
    )
    notes = (
        f"Indicative, without verdict: how this ship's propeller brakes was not measured. An Administration may allow ships of"
        f" large displacement up to {standards.MOST_TRACK_REACH:g} L.",
        f"Order: {'pitch ratio' if turned else 'shaft'} {pitch if turned else shaft:.3g}{'' if turned else ' rev/s'}.",
    )
    return Trial("stopping", setting, 0.0, (Run("", "", v, found, rows),), notes=(*notes, *_notes(setting, [v], True)))


TRIALS: dict[str, Callable[[Vessel, float | None, float | None], Trial]] = {
    "turning-circle": turning_circle,
    "zigzag": zigzag,
    "williamson": williamson,
    "pull-out": pull_out,
    "spiral": spiral,
    "stopping": stopping,
}
