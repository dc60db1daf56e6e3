"""Which ship is this today? A ship's own past, followed by a filter whose state is the correction of the network (see `similarity`).

The voyage so far is cut into parts of a third of the horizon. From the filtered states at the begin of each the corrected network runs on
under the orders that were in force, and how far from its end the ship came to be, in place and heading, corrects the nine
parameters and the current beside them (iterated extended Kalman filter; the derivatives are further rows of one batch). The
parameters wander, so that old parts are forgotten, and all their variance is given back when the ship has become another.

The correction is used where it is sure, by the gain of likelihood as a current is, and does better than the network itself of late.
Until then, and on the ship of the training for good, a tracked prediction is the untracked one, bit for bit. Nothing after the
start of a prediction is read.

Multiplying the coefficients of an identified ship in its place (surge, sway and yaw by hull, turn and rudder) was tried on four voyages in
ballast: 12 / 85 m at 90 s after new orders where this gives 4 / 16 m, since its terms are too much alike to be told apart.
"""

import math
from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np

from aspnn.angles import difference
from aspnn.learning.features import broken
from aspnn.learning.windows import plans_sailed
from aspnn.prediction import carried
from aspnn.prediction.current import USUAL as CURRENT
from aspnn.prediction.current import part
from aspnn.prediction.learned import Material, Network, draw, material, through_water
from aspnn.prediction.monitor import MARKS, Ended, errors, marks, misfit
from aspnn.prediction.similarity import NAMES, USUAL, similar
from aspnn.prediction.uncertainty import Calibration, at_times, shape
from aspnn.records import States

SHIP = len(NAMES)  # parameters of the ship; two of the current follow
PRIOR = np.concatenate([USUAL, [CURRENT, CURRENT]])
# Twice the gain of log-likelihood that a correction must bring. In half an hour the ship of the training reached 11 at most (16 voyages
# in calm and in currents), 33 in winds of up to 10 m/s that the network does not know (5); the same ship at 4.3 m of draught 260 to
# 1,700 after five minutes, at 5.4 m 41 to 280.
SURE = 40.0
COARSE = 2.0  # on the standard deviations of the network's errors after a part: a corrected network is less good than a taught one
FORGET = 1e-5  # of the prior's variance comes back every second: all of it in 28 hours
ROUNDS = 2  # of linearising at each part; a third changed errors by less than a tenth
STEP = 1e-3  # of the differences, in units of the parameters
# The ship has become another where the mean squared innovation of two parts running, over its variance, is beyond this.
ANOTHER = 16.0
LATELY = 4  # parts: two minutes of a ship
LASTING = 20  # parts over which errors are judged: ten minutes of a ship
LOGARITHM = np.array([-0.369, -1.270])  # mean logarithm of chi^2_3 / 3 and of chi^2_1: digamma(k / 2) + ln(2 / k)
DOUBT = 4.0  # as many times the variance is told as long as no corrected prediction has ended (assumed)


class Ship(carried.Contract, Protocol):
    """What a checkpoint says of its network; see `carried.Contract`."""


class Tracks(NamedTuple):
    """The corrections known at `time` (k,) [s], the first of them the prior at the begin of the states.

    `mean` (k, 11): the parameters in the order of NAMES, then the current towards north and east [m/s]; `covariance` (k, 11, 11);
    `square` (k,): mean squared innovation of a part over the variance that calibration and the correction's own uncertainty give it,
    NaN for the prior; `restarted` (k,): whether the variance was given back there; `place` (k,) [m], where the ship was, by which
    other states are told from these; `erred` (k, 2): squared errors over the part as calibration told their variance, with the
    correction known before it and without; `misfit` (k, MARKS, 2): see `monitor.misfit`, of the prediction that ended then, with
    the correction that was known at its start, NaN where that was not sure.
    """

    time: np.ndarray
    mean: np.ndarray
    covariance: np.ndarray
    square: np.ndarray
    restarted: np.ndarray
    place: np.ndarray
    erred: np.ndarray
    misfit: np.ndarray

    def left(self, k: int) -> np.ndarray:
        """How much larger than told the squared errors of corrected predictions were up to instant k, (MARKS, 2) as `monitor.misfit`.

        Of the predictions that ended in the last LASTING parts and since a restart, and two of square DOUBT that nobody saw: the
        mean of the logarithms, which the first ones, made when little was known, do not outweigh, as Gaussian errors have it.
        """
        first = max(k + 1 - LASTING, int(np.flatnonzero(self.restarted[: k + 1]).max(initial=0)))
        some = self.misfit[first : k + 1]
        some = some[np.isfinite(some).all(axis=(1, 2))]
        return np.exp((2 * math.log(DOUBT) + (np.log(some) - LOGARITHM).sum(axis=0)) / (2 + len(some)))

    @property
    def gain(self) -> np.ndarray:
        """Twice the gain (k,) of log-likelihood of the ship's parameters, whatever the current: p^T P^-1 p."""
        own, spread = self.mean[:, :SHIP], self.covariance[:, :SHIP, :SHIP]
        return np.einsum("ki,ki->k", own, np.linalg.solve(spread, own[..., None])[..., 0])

    @property
    def sure(self) -> np.ndarray:
        """Whether each (k,) is used: its gain is beyond SURE, and over the last LATELY parts it erred less than the network itself."""
        total = np.cumsum(np.concatenate([np.zeros((LATELY, 2)), np.nan_to_num(self.erred)]), axis=0)
        corrected, itself = (total[LATELY:] - total[:-LATELY]).T
        return (self.gain > SURE) & (corrected < itself)


def begin(states: States) -> Tracks:
    """What is known before anything has been sailed."""
    at = np.hypot(states["north_m"][:1], states["east_m"][:1])
    return Tracks(
        time=states["time_s"][:1].copy(),
        mean=np.zeros((1, len(PRIOR))),
        covariance=np.diag(PRIOR**2)[None],
        square=np.array([np.nan]),
        restarted=np.array([False]),
        place=at,
        erred=np.full((1, 2), np.nan),
        misfit=np.full((1, len(MARKS), 2), np.nan),
    )


def follow(
    contract: Ship, network: Network, calibration: Calibration, states: States, known: Tracks | None = None
) -> Tracks:
    """The corrections at the end of every part of a voyage, those `known` of its earlier states first.

    Parts lie on a grid that begins with the states, so that a voyage followed bit by bit gives what it gives at once. A part
    that coasts or lacks values is left out.
    """
    spec, time = contract.spec, states["time_s"]
    known = begin(states) if known is None else known
    span = part(spec)
    first, before = time[0] + spec.period * spec.history_steps, spec.period * (spec.history_steps - 1)
    begins = first + span * np.arange(max(int((time[-1] - first + 1e-6) // span), 0))
    begins = begins[begins + span > known.time[-1] + 1e-6]
    rows = np.searchsorted(time, begins - 1e-6)
    unusable = broken(states, spec.read, spec.period)
    ends = np.searchsorted(time, time[rows] + span - 1e-6)
    fit = ends < len(time)
    ends = np.minimum(ends, len(time) - 1)
    fit &= unusable[ends + 1] == unusable[np.searchsorted(time, time[rows] - before - 1e-6)]
    rows = rows[fit]
    if not len(rows):
        return known
    pieces = Parts.of(contract, states, rows, span, calibration)
    answer = pieces.answer(contract, network)
    found = [_last(known)]
    for k in range(len(rows)):
        found.append(_step(found[-1], pieces, k, answer))
    later = [np.array(values) for values in zip(*found[1:], strict=True)]
    unjudged = np.full((len(rows), len(MARKS), 2), np.nan)
    tracks = Tracks(*(np.concatenate(both) for both in zip(known, (*later, unjudged), strict=True)))
    return tracks._replace(misfit=judged(contract, network, calibration, states, tracks, len(known.time)))


def judged(
    contract: Ship, network: Network, calibration: Calibration, states: States, found: Tracks, first: int
) -> np.ndarray:
    """The misfits (k, MARKS, 2) of `found`, those from instant `first` on made now: each of the prediction that ended then."""
    spec, time, misfits = contract.spec, states["time_s"], found.misfit.copy()
    begun = found.time - spec.horizon
    known = np.searchsorted(found.time, begun + 1e-6, side="right") - 1
    told = (known >= 0) & found.sure[known] & (np.arange(len(known)) >= first)
    told &= begun >= time[0] + spec.period * spec.history_steps - 1e-6
    rows = np.searchsorted(time, begun + 1e-6, side="right") - 1  # never the epoch after: that would end later
    unusable = broken(states, spec.read, spec.period)
    before = np.searchsorted(time, time[rows] - spec.history - 1e-6)
    told &= unusable[np.searchsorted(time, found.time + 1e-6, side="right")] == unusable[before]
    for k in np.flatnonzero(told):  # one by one: beside other rows a network may round otherwise
        row, own = rows[k : k + 1], found.mean[known[k] : known[k] + 1]
        plans = plans_sailed(states, time[row], spec.horizon, spec.forcings)
        corrected = similar(network, spec, contract.vessel, own[:, :SHIP])
        path, covariance, _ = carried.predict_carried(contract, corrected, states, row, plans, False, own[:, SHIP:])
        covariance = shape(calibration, path, covariance, plans, states["rudder_angle_rad"][row])[:, marks(path.time)]
        ended = Ended(np.array([0]), row, tuple(plans))
        misfits[k] = misfit(ended.start, *errors(ended, path, states), covariance, 1)[0]
    return misfits


class Parts(NamedTuple):
    """What the network sees at the begins of m parts, where and when the ship came out (m, 3), and the variances (m, 3) of that."""

    given: Material
    end: np.ndarray
    time: np.ndarray
    variance: np.ndarray
    steps: int
    span: float

    @staticmethod
    def of(contract: Ship, states: States, rows: np.ndarray, span: float, calibration: Calibration) -> "Parts":
        """The parts that begin at `rows`, all of them in the states."""
        spec, time = contract.spec, states["time_s"]
        plans = plans_sailed(states, time[rows], span, spec.forcings)
        given, steps, at = material(contract, states, rows, plans), round(span / spec.period), time[rows] + span
        names = ("north_m", "east_m", "heading_rad")
        end = np.stack([np.interp(at, time, states[name]) for name in names], axis=-1)
        own = [states[f"{name}_sd"] ** 2 for name in names]
        both = np.stack([values[rows] + np.interp(at, time, values) for values in own], axis=-1)
        loss = states["surge_m_s"][rows] - np.interp(at, time, states["surge_m_s"])
        begun = states["rudder_angle_rad"][rows]
        order = [np.abs(plan.rudder.values - angle).max() for plan, angle in zip(plans, begun, strict=True)]
        driven = (
            np.stack([np.ones(len(rows)), end[:, 2] - given.pose[:, 2], order, loss]) ** 2
        )  # as uncertainty.drivers
        heading = at_times(calibration.variance, calibration.time, np.array([span]))[0, 2] @ driven
        place = np.full(len(rows), calibration.drift**2)
        return Parts(
            given=given._replace(forcing=given.forcing[:, : steps + 1]),
            end=end,
            time=at,
            variance=np.stack([place, place, heading], axis=-1) + both,
            steps=steps,
            span=span,
        )

    def answer(self, contract: Ship, network: Network) -> Callable[[int, np.ndarray], np.ndarray]:
        """Where the network ends part k (v, 3) under v corrections (v, 11)."""

        def ended(k: int, x: np.ndarray) -> np.ndarray:
            given = Material(*(np.repeat(array[k : k + 1], len(x), axis=0) for array in self.given))
            seen = through_water(given, contract.spec, x[:, SHIP:])
            velocities = similar(network, contract.spec, contract.vessel, x[:, :SHIP])(
                seen.history, seen.forcing, seen.wind
            )
            path = draw(contract, given.pose, velocities, False)
            flow = x[:, SHIP:] * self.span
            return np.stack(
                [path.north[:, -1] + flow[:, 0], path.east[:, -1] + flow[:, 1], path.heading[:, -1]], axis=-1
            )

        return ended


class _At(NamedTuple):
    time: float
    mean: np.ndarray
    covariance: np.ndarray
    square: float
    restarted: bool
    place: float
    erred: np.ndarray


def _last(known: Tracks) -> _At:
    return _At(*(values[-1] for values in known[: len(_At._fields)]))


def _step(last: _At, pieces: Parts, k: int, answer: Callable[[int, np.ndarray], np.ndarray]) -> _At:
    """The correction after part k, from that before it."""
    time = float(pieces.time[k])
    prior = last.covariance + np.diag(FORGET * (time - last.time) * PRIOR**2)
    mean, covariance, square, erred = _corrected(last.mean, prior, pieces, k, answer)
    restarted = square > ANOTHER and last.square > ANOTHER and not last.restarted
    if restarted:
        mean, covariance, *_ = _corrected(last.mean, prior + np.diag(PRIOR**2), pieces, k, answer)
    return _At(time, mean, covariance, square, restarted, float(np.hypot(*pieces.end[k, :2])), erred)


def _corrected(
    mean: np.ndarray, prior: np.ndarray, pieces: Parts, k: int, answer: Callable[[int, np.ndarray], np.ndarray]
) -> tuple[np.ndarray, np.ndarray, float, np.ndarray]:
    """Mean and covariance after part k of a belief, the mean square of the innovation over its variance, and `Tracks.erred` (2,).

    x <- m + K (e + J (x - m)) with K = P J^T (J P J^T + R)^-1 about x, ROUNDS times; P by Joseph's form.
    """
    x, told, square, erred = mean, np.diag(pieces.variance[k]), np.nan, np.full(2, np.nan)
    itself = np.concatenate([np.zeros(SHIP), mean[SHIP:]])
    noise = COARSE**2 * told
    for round_ in range(ROUNDS):
        here, *moves, plain = answer(k, np.concatenate([x[None], x + STEP * np.eye(len(x)), itself[None]]))
        J = (np.array(moves) - here).T / STEP
        off, without = (pieces.end[k] - end for end in (here, plain))
        off[2], without[2] = (difference(pieces.end[k, 2], end[2]) for end in (here, plain))
        S = J @ prior @ J.T + noise
        if round_ == 0:
            square = float(off @ np.linalg.solve(J @ prior @ J.T + told, off)) / len(off)
            erred = np.array([(miss**2 / pieces.variance[k]).sum() for miss in (off, without)])
        K = np.linalg.solve(S, J @ prior).T
        x = mean + K @ (off + J @ (x - mean))
    rest = np.eye(len(x)) - K @ J
    return x, rest @ prior @ rest.T + K @ noise @ K.T, square, erred
