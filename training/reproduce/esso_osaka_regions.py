"""Regions of a cross-validated predictor, calibrated on the folds that a window does not belong to; and the noise of labels.

Depends on the evaluation alone: every window has been predicted by a network that never saw its voyage.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from aspnn.angles import difference
from aspnn.evaluation.evaluate import Evaluation
from aspnn.evaluation.windows import STEADY
from aspnn.motion import Path
from aspnn.orders import Plan
from aspnn.prediction.calibration import conformal, fit_correlation, fit_variance, scores
from aspnn.prediction.uncertainty import FULL, axes, drivers
from aspnn.records import Log, States

MEASURED = ("midship_north_m", "midship_east_m", "heading_deg", "yaw_rate_deg_s")
JUMP = 0.05  # m in a step of the horizon: five times the noise of a fix
BLOCK = 1.0  # s of samples that each half of the sensors' record gets in turn


class Carries(Protocol):
    """What regions ask of a predictor."""

    def predict_carried(self, states: States, rows: np.ndarray, plans: Sequence[Plan]) -> tuple[Path, np.ndarray]: ...


@dataclass(frozen=True)
class Carried:
    """Windows (n,) at the rule's horizons: errors and the filter's covariance in course axes, drivers, and both in the grid.

    errors (n, horizons, 3) north, east [m], heading [rad]; covariance (n, horizons, 3, 3) of the same by the filter's errors;
    turn (n, horizons, 3, 3) from course to grid axes (uncertainty.axes); driving (n, horizons, 6): see `driving`.
    """

    errors: np.ndarray
    covariance: np.ndarray
    turn: np.ndarray
    driving: np.ndarray

    def select(self, which: np.ndarray) -> "Carried":
        """The windows at `which` (indices or mask)."""
        return Carried(self.errors[which], self.covariance[which], self.turn[which], self.driving[which])


@dataclass(frozen=True)
class Regions:
    """95 % regions of windows at the rule's horizons, each (n, horizons): whether they held, area [m2], half-width [rad]."""

    position: np.ndarray
    heading: np.ndarray
    area: np.ndarray
    width: np.ndarray


def carry(evaluation: Evaluation, states: Sequence[States], predictor: Carries) -> Carried:
    """What the filter's errors become in each window of an evaluation, and the errors themselves."""
    horizons = np.array(evaluation.rule.horizons)
    columns = [evaluation.column(h) for h in horizons]
    begin = evaluation.windows["time_s"].to_numpy()
    parts = []
    for voyage, of in enumerate(states):
        which = np.flatnonzero(evaluation.windows["voyage"].to_numpy() == voyage)
        if not len(which):
            continue
        rows, plans = np.searchsorted(of["time_s"], begin[which] - 1e-6), [evaluation.plans[k] for k in which]
        path, covariance = predictor.predict_carried(of, rows, plans)
        driven = driving(path, plans, of["rudder_angle_rad"][rows], of["yaw_acceleration_rad_s2"][rows])
        at = [int(np.argmin(np.abs(path.time - h))) for h in horizons]
        path, true = path.at(path.time[at]), evaluation.reference[which]
        errors = [path.north - true.north[:, columns], path.east - true.east[:, columns]]
        errors.append(difference(path.heading, true.heading[:, columns]))
        parts.append((np.stack(errors, axis=-1), covariance[:, at], axes(path), driven[:, at]))
    return Carried(*(np.concatenate(values) for values in zip(*parts, strict=True)))


def driving(path: Path, plans: Sequence[Plan], angle: np.ndarray, yaw: np.ndarray) -> np.ndarray:
    """What the model's error grows with (n, steps, 6): `uncertainty.drivers` and two more of this regime's, squared.

    The order so far times the distance run [rad m]: a rudder's force goes with the square of the speed, so that is how an
    error of the order's effect moves a place, and zigzags run twice as fast as the rest. And `yaw` (n,), the yaw acceleration
    at the start [rad/s2]: in the middle of a manoeuvre the state is known less well. Both were chosen by the likelihood of
    errors in folds that neither the network nor the regression had seen.
    """
    known = drivers(path, plans, angle)
    speed, steps = np.hypot(path.surge, path.sway), np.diff(path.time)
    run = np.cumsum(steps * (speed[:, 1:] + speed[:, :-1]) / 2, axis=1)
    run = np.concatenate([np.zeros((len(run), 1)), run], axis=1)
    own = [known[..., 2] * run**2, np.broadcast_to(yaw[:, None] ** 2, run.shape)]
    return np.concatenate([known, np.stack(own, axis=-1)], axis=-1)


def cross_conformal(windows: Carried, fold: np.ndarray, population: np.ndarray) -> Regions:
    """95 % regions of every window (n,) from the windows of other folds alone.

    For the windows of fold i, the model's error is shaped on all other folds, and the factor is the conformal quantile of
    the scores of each other fold j, those by a shape found without i and j, within the window's population: the
    cross-conformal scheme of Vovk (2015) and, with one fold a voyage, the jackknife+ of Barber et al. (2021), both recalled.
    """
    n, horizons = windows.errors.shape[:2]
    held, turned, area, width = (np.full((n, horizons), np.nan) for _ in range(4))
    names = np.unique(fold)
    for own in names:
        inner = np.flatnonzero(fold != own)
        marks = np.full((2, n, horizons), np.nan)
        for other in names[names != own]:
            there = np.flatnonzero(fold == other)
            known = _shape(windows.select(inner[fold[inner] != other]))
            marks[:, there] = scores(windows.errors[there], known(windows.select(there)))
        here = np.flatnonzero(fold == own)
        covariance = _shape(windows.select(inner))(windows.select(here))
        place, heading = scores(windows.errors[here], covariance)
        for name in np.unique(population[here]):
            like, those = inner[population[inner] == name], population[here] == name
            far, off = (conformal(mark[like])[:, FULL] for mark in marks)
            held[here[those]], turned[here[those]] = place[those] <= far, heading[those] <= off
            area[here[those]] = np.pi * far**2 * np.sqrt(np.linalg.det(covariance[those][..., :2, :2]))
            width[here[those]] = off * np.sqrt(covariance[those][..., 2, 2])
    return Regions(held, turned, area, width)


def _shape(windows: Carried) -> Callable[[Carried], np.ndarray]:
    """How the covariance (n, horizons, 3, 3) of others follows from what is known of them, as these windows have it."""
    back = np.swapaxes(windows.turn, -1, -2)
    errors = np.einsum("...ab,...b->...a", back, windows.errors)
    known = np.einsum("...ab,...bc,...ac->...a", back, windows.covariance, back)
    variance = fit_variance(errors, known, windows.driving)
    correlation = fit_correlation(errors, known, windows.driving, variance)

    def covariance(others: Carried) -> np.ndarray:
        sd = np.sqrt(np.einsum("tak,ntk->nta", variance, others.driving))
        turned = others.turn * sd[..., None, :]
        return others.covariance + turned @ correlation @ np.swapaxes(turned, -1, -2)

    return covariance


def populations(evaluation: Evaluation) -> np.ndarray:
    """The population of each window, known at its start: steady or not. New orders that are held are too few by themselves."""
    return (evaluation.windows["group"] == STEADY).to_numpy()


def jumping(evaluation: Evaluation) -> np.ndarray:
    """Whether the label of each window (n,) jumps: in some step its place moves JUMP further than its own velocities say.

    There the filter had refused fixes, rightly or not, until it took them again elsewhere. No predictor can know, and neither
    the smoother's deviations nor halves of the record tell: both believe what the gate let through.
    """
    path = evaluation.reference
    over_ground = (path.surge + 1j * path.sway) * np.exp(1j * path.heading)
    sailed = np.diff(path.time) * (over_ground[:, 1:] + over_ground[:, :-1]) / 2
    found: np.ndarray = (np.abs(np.diff(path.north + 1j * path.east, axis=1) - sailed) > JUMP).any(axis=1)
    return found


@dataclass(frozen=True)
class Floor:
    """Noise of the labels in each window (n, horizons): by the smoother, and by halves of the record. Places [m], headings [rad].

    `smoother` are its own standard deviations: root of the sum over north and east, and heading. `halves` are half the distances
    between two smoothed motions, each from every other second of the sensors: what differs between them is white over
    more than a second, what they share (an offset, a slow wander) is not seen.
    """

    smoother: tuple[np.ndarray, np.ndarray]
    halves: tuple[np.ndarray, np.ndarray]


def label_floor(evaluation: Evaluation, logs: Sequence[Log], smooth: Callable[[Log], States]) -> Floor:
    """The noise of the labels that an evaluation of `logs` was measured against."""
    begin = evaluation.windows["time_s"].to_numpy()
    found: dict[str, list[np.ndarray]] = {name: [] for name in ("sd", "heading_sd", "apart", "heading_apart")}
    for voyage, log in enumerate(logs):
        start = begin[evaluation.windows["voyage"].to_numpy() == voyage]
        if not len(start):
            continue
        at = start[:, None] + np.array(evaluation.rule.horizons)
        whole = smooth(log)
        sd = {k: np.interp(at, whole["time_s"], whole[f"{k}_sd"]) for k in ("north_m", "east_m", "heading_rad")}
        first, second = (_motion(smooth(half(log, which)), at) for which in (0, 1))
        found["sd"].append(np.hypot(sd["north_m"], sd["east_m"]))
        found["heading_sd"].append(sd["heading_rad"])
        found["apart"].append(np.hypot(first["north_m"] - second["north_m"], first["east_m"] - second["east_m"]) / 2)
        found["heading_apart"].append(np.abs(difference(first["heading_rad"], second["heading_rad"])) / 2)
    values = {name: np.concatenate(parts) for name, parts in found.items()}
    return Floor((values["sd"], values["heading_sd"]), (values["apart"], values["heading_apart"]))


def half(log: Log, which: int) -> Log:
    """The log with the sensors of every other second alone: the even ones (`which` 0) or the odd ones (1)."""
    table = log.table.copy()
    blank = (np.floor(table["time_s"] / BLOCK + 1e-6).astype(int) % 2 != which).to_numpy()
    for name in MEASURED:
        if name in table:
            table.loc[blank, name] = np.nan
    return replace(log, table=table)


def _motion(states: States, at: np.ndarray) -> Mapping[str, np.ndarray]:
    """Place and continuous heading at instants `at` [s]."""
    names = ("north_m", "east_m", "heading_rad")
    values = {name: np.unwrap(states[name]) if name == "heading_rad" else states[name] for name in names}
    return {name: np.interp(at, states["time_s"], values[name]) for name in names}
