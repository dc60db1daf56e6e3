"""What to leave to kinematics: the shares of prediction.choice, fixed on voyages that taught the network nothing.

For each phase and knot of time the shares 0, 0.1 ... 1 are judged by median and 95th percentile of the error over those of the
better part, under draws of whole voyages with replacement, so that luck of the draw is not taken for merit. Shares never rise
with time: extrapolated motion only grows worse.
"""

import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from aspnn import __version__
from aspnn.angles import difference, wrap
from aspnn.evaluation.reference import Voyage
from aspnn.evaluation.windows import STEADY, Rule, find_starts
from aspnn.motion import Path
from aspnn.orders import Plan
from aspnn.prediction.choice import MOTIONS, PHASES, HybridChoice
from aspnn.prediction.kinematic import KinematicPredictor
from aspnn.records import States
from aspnn.schema import InputError

if TYPE_CHECKING:
    from rich.table import Table

# Shares of the horizon: close together where a ship's kinematics give way to the network (1 to 40 s of 90).
KNOTS = np.array([1, 2, 3, 4.5, 6, 8, 10, 12.5, 15, 17.5, 20, 22.5, 25, 30, 35, 40, 45, 50, 60, 70, 80, 90]) / 90
SHARES = np.arange(11) / 10
SHARE = (50.0, 95.0)  # percentiles that are judged
DRAWS = 25  # of voyages
WORSE = 5.0  # how much more a per cent above the better part counts than one below it
MIXING = 0.02  # what a share between 0 and 1 must win, in parts of the error
LEANING = 0.005  # what the kinematic path must win over the network
VOYAGES = 6  # at least
WINDOWS = 40  # of a phase at least: the 95th percentile of fewer is one or two windows


class Predicts(Protocol):
    """What is asked of the network alone."""

    @property
    def name(self) -> str: ...

    @property
    def horizon(self) -> float: ...

    def predict_many(self, states: States, rows: np.ndarray, plans: Sequence[Plan]) -> Path: ...


@dataclass(frozen=True)
class _Part:
    """The windows of one voyage: errors (n, knots, 3) of the network in north, east, heading; kinematic minus network by model."""

    errors: np.ndarray
    apart: dict[str, np.ndarray]
    steady: np.ndarray


def choose(network: Predicts, voyages: Iterable[Voyage], rule: Rule, taught: Iterable[str]) -> HybridChoice:
    """Fix the choice for a network (predicting alone) on the windows of `voyages` by `rule`, which taught it nothing.

    The kinematic model is the one whose choice errs least. Raises InputError for a voyage among `taught`, and for fewer than
    six voyages with windows.
    """
    horizon, taught = network.horizon, set(taught)
    knots, rule = horizon * KNOTS, replace(rule, horizons=(horizon,))
    parts: list[_Part] = []
    digest, names, kinds = hashlib.sha256(), [], set()
    for voyage in voyages:
        name = voyage.states.voyage
        if name in taught:
            raise InputError(
                f"{voyage.name or name}: voyage {name} trained checkpoint {network.name}; choose on voyages it has not seen"
            )
        digest.update(voyage.sha256.encode())
        kinds.add(voyage.reference.kind)
        part = _measure(network, voyage, rule, knots)
        if part is not None:
            parts.append(part)
            names.append(name)
    if len(parts) < VOYAGES:
        raise InputError(
            f"choosing for {network.name}: {len(parts)} voyages have windows, {VOYAGES} are needed; "
            f"a window needs {rule.history:g} s before its start and {horizon:g} s after it"
        )
    found, least, counts = None, np.inf, {}
    for motion in MOTIONS:
        tables: dict[str, dict[str, np.ndarray]] = {"place": {}, "heading": {}}
        total = 0.0
        for phase in PHASES:
            rows = [part.steady == (phase == "steady") for part in parts]
            errors = [part.errors[kept] for part, kept in zip(parts, rows, strict=True)]
            apart = [part.apart[motion][kept] for part, kept in zip(parts, rows, strict=True)]
            windows = sum(len(e) for e in errors)
            counts[phase] = {"windows": windows, "voyages": sum(len(e) > 0 for e in errors)}
            for key, axes in (("place", slice(0, 2)), ("heading", slice(2, 3))):
                if windows < WINDOWS:
                    tables[key][phase] = np.zeros(len(knots))
                    continue
                tables[key][phase], cost = fit_shares([e[..., axes] for e in errors], [a[..., axes] for a in apart])
                total += cost
        if total < least:
            found, least = (motion, tables), total
    if found is None:
        raise InputError(
            f"choosing for {network.name}: no phase has the {WINDOWS} windows it takes; give more or longer logs"
        )
    facts: dict[str, Any] = {
        "aspnn": __version__,
        "voyages": names,
        "data_sha256": digest.hexdigest(),
        "reference": " and ".join(sorted(kinds)),
        "phases": counts,
    }
    return HybridChoice(found[0], knots, found[1]["place"], found[1]["heading"], rule.steady_before, facts)


def _measure(network: Predicts, voyage: Voyage, rule: Rule, knots: np.ndarray) -> _Part | None:
    states = voyage.states
    starts = find_starts(states, rule, voyage.shaft)
    starts = starts.keep(voyage.reference.known(states["time_s"][starts.rows], rule.horizon), "no reference")
    if not len(starts.rows):
        return None
    path = network.predict_many(states, starts.rows, starts.plans)
    learned = path.at(np.minimum(knots, path.time[-1]))
    truth = voyage.reference.path(states["time_s"][starts.rows], knots)
    errors = [learned.north - truth.north, learned.east - truth.east, difference(learned.heading, truth.heading)]
    apart = {}
    for name, motion in MOTIONS.items():
        moved = KinematicPredictor(states.vessel, motion, rule.horizon, rule.horizon / 900, rule.horizon / 900)
        other = moved.predict_many(states, starts.rows, ()).at(knots)
        apart[name] = np.stack([getattr(other, k) - getattr(learned, k) for k in ("north", "east", "heading")], axis=-1)
    return _Part(np.stack(errors, axis=-1), apart, starts.groups == STEADY)


def fit_shares(errors: Sequence[np.ndarray], apart: Sequence[np.ndarray], seed: int = 0) -> tuple[np.ndarray, float]:
    """Shares (knots,) of the other path, never rising, and the mean logarithm of the errors they leave.

    `errors` of the network and `apart`, the other path minus it, hold an array (windows, knots, axes) for each voyage: two axes
    of places [m], one of headings [rad]. A share costs, at a knot and with r the ratios of median and 95th percentile to the
    better part's, mean(log r) + WORSE max(log r)+, averaged over draws of voyages, and what mixing and kinematics must win.
    The shares are those of the least total, by dynamic programming over the knots.
    """
    voyage = np.repeat(np.arange(len(errors)), [len(e) for e in errors])
    e, d = np.concatenate(errors), np.concatenate(apart)
    rng = np.random.default_rng(seed)
    present = np.unique(voyage)
    rows = {name: np.flatnonzero(voyage == name) for name in present}
    draws = [np.concatenate([rows[name] for name in rng.choice(present, len(present))]) for _ in range(DRAWS)]
    knots = e.shape[1]
    cost, left = np.empty((knots, len(SHARES))), np.empty((knots, len(SHARES)))
    for k in range(knots):
        off = e[:, k, None] + SHARES[:, None] * d[:, k, None]  # (windows, shares, axes)
        size = np.abs(wrap(off[..., 0])) if off.shape[-1] == 1 else np.linalg.norm(off, axis=-1)
        # Errors of exactly nothing (made-up voyages) have no ratio; a nanometre is nothing.
        logs = np.log(np.maximum([np.percentile(size[draw], SHARE, axis=0) for draw in draws], 1e-9))
        ratio = logs - np.minimum(logs[..., :1], logs[..., -1:])
        left[k] = logs.mean(axis=(0, 1))
        cost[k] = (ratio.mean(axis=1) + WORSE * np.maximum(ratio.max(axis=1), 0.0)).mean(axis=0)
    cost += LEANING * SHARES + MIXING * ((SHARES > 0) & (SHARES < 1))
    best = falling(cost)
    return SHARES[best], float(left[np.arange(knots), best].mean())


def falling(cost: np.ndarray) -> np.ndarray:
    """The columns (knots,), never rising, of least total `cost` (knots, columns); of equals the lower ones."""
    knots, columns = cost.shape
    total = cost[0].copy()
    came = np.zeros((knots, columns), int)
    for k in range(1, knots):
        # The best way to column j comes from one of the columns at or above it.
        best = np.array([j + int(np.argmin(total[j:])) for j in range(columns)])
        came[k], total = best, total[best] + cost[k]
    path = [int(np.argmin(total))]
    for k in range(knots - 1, 0, -1):
        path.append(int(came[k, path[-1]]))
    return np.array(path[::-1])


def table(choice: HybridChoice) -> "Table":
    """Windows and voyages by phase, and until when place and heading are the kinematic ones, and mixed."""
    from rich.table import Table

    shown = Table(
        title=f"What is left to {choice.kinematic}",
        caption="Seconds from the start, or from the order; the rest is the network's.",
        caption_justify="left",
    )
    shown.add_column("phase", no_wrap=True)
    for name in ("windows", "voyages", "place", "heading"):
        shown.add_column(name, justify="right", no_wrap=True)
    for phase in PHASES:
        counts = choice.facts["phases"][phase]
        cells = [_span(choice.time, shares[phase]) for shares in (choice.place, choice.heading)]
        shown.add_row(phase, str(counts["windows"]), str(counts["voyages"]), *cells)
    return shown


def _span(time: np.ndarray, share: np.ndarray) -> str:
    whole, part = time[share == 1], time[share > 0]
    if not len(part):
        return "nothing"
    words = [f"to {whole[-1]:.3g} s"] if len(whole) else []
    return ", ".join([*words, *([f"mixed to {part[-1]:.3g} s"] if share[share > 0][-1] < 1 else [])])
