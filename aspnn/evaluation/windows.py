"""Where predictions start: at rudder orders and in steady stretches, in groups that are never mixed.

`new_order` starts at an order change of at least 5 deg, at least 5 s after the last one, held for the whole horizon;
`orders_within_horizon` starts at such a change with a further one inside the horizon; `order` is both together;
`steady` has no order from some time before the start to the end of the horizon. An order exactly at the end of the
horizon does not act inside it. A helm that closes a loop (an autopilot, a person at the wheel) orders all the time by little, so that
these hardly fill: `steered` starts every so many seconds whatever is ordered, where a rule asks for it, and its windows may be those of
other groups too. As everywhere the plan that predictors get is what was ordered then. Depends on records and orders only.
"""

import math
from collections import Counter
from dataclasses import dataclass, field

import numpy as np

from aspnn.orders import Orders, Plan
from aspnn.records import States
from aspnn.vessel import Vessel

NEW, WITHIN, STEADY, ORDER, STEERED = "new_order", "orders_within_horizon", "steady", "order", "steered"
GROUPS = (NEW, WITHIN, ORDER, STEADY)  # those of every rule
MODEL_SHIP_LENGTH = 10.0  # m: a shorter hull is a model ship, whose time runs faster


@dataclass(frozen=True)
class Rule:
    """Which windows are scored, and at which horizons. Times [s], angles [rad]; the defaults are those of a ship."""

    horizons: tuple[float, ...] = (15.0, 30.0, 45.0, 60.0, 75.0, 90.0)
    history: float = 120.0  # known before the start, the same for every predictor
    steady_before: float = 30.0  # without an order before a steady start
    steady_every: float = 15.0  # between steady starts inside one stretch
    order_change: float = math.radians(5)
    order_apart: float = 5.0
    steered_every: float | None = None  # between `steered` starts; None: there are none
    headline: tuple[str, ...] = (NEW, WITHIN, STEADY)  # the groups that tables and figures show

    @property
    def horizon(self) -> float:
        """The longest horizon [s]."""
        return max(self.horizons)

    @property
    def groups(self) -> tuple[str, ...]:
        """The groups that there may be windows of, `order` for two of them together."""
        return GROUPS if self.steered_every is None else (*GROUPS, STEERED)

    @property
    def shown(self) -> tuple[str, ...]:
        """The groups that tables and figures show."""
        return self.headline if self.steered_every is None else (*self.headline, STEERED)

    @staticmethod
    def of(vessel: Vessel) -> "Rule":
        """The rule of a ship, or of a model ship (shorter than 10 m: horizons 10 to 30 s, short holds)."""
        return MODEL_SHIP if vessel.length < MODEL_SHIP_LENGTH else SHIP


SHIP = Rule()
MODEL_SHIP = Rule(horizons=(10.0, 20.0, 30.0), history=20.0, steady_before=10.0, headline=(ORDER, STEADY))


@dataclass(frozen=True)
class Starts:
    """Starts of one voyage, in time order: row of the states, group (never `order`) and what was planned then.

    `excluded` counts the starts that were found and not used, by reason.
    """

    rows: np.ndarray
    groups: np.ndarray
    plans: tuple[Plan, ...]
    excluded: Counter = field(default_factory=Counter)

    def keep(self, kept: np.ndarray, reason: str) -> "Starts":
        """The starts where `kept` is true; the others are counted under `reason`."""
        plans = tuple(plan for plan, keep in zip(self.plans, kept, strict=True) if keep)
        excluded = self.excluded + Counter({reason: int(np.sum(~kept))})
        return Starts(self.rows[kept], self.groups[kept], plans, excluded)


def find_starts(states: States, rule: Rule, shaft: Orders | None = None) -> Starts:
    """The starts of one voyage by `rule`, with the plans that were in force: rudder orders, and `shaft` orders if known.

    A measured shaft speed is not a plan: without shaft orders the shaft is held as it is.
    """
    time, horizon = states["time_s"], rule.horizon
    orders = Orders.from_series(time, states["rudder_order_rad"])
    found: list[tuple[float, str]] = []
    for change in orders.changes(rule.order_change, rule.order_apart):
        held = orders.held_within(change, change + horizon, rule.order_change)
        found.append((float(change), NEW if held else WITHIN))
    found += [(float(start), STEADY) for start in _steady_starts(orders, time, rule)]
    if rule.steered_every is not None:
        every = np.arange(time[0] + rule.history, time[-1] - horizon + 1e-6, rule.steered_every)
        found += [(float(start), STEERED) for start in every]
    found.sort()
    rows = np.searchsorted(time, np.array([start for start, _ in found]) - 1e-6)
    groups = np.array([group for _, group in found], dtype=object)
    begin = time[rows]
    plans = tuple(
        Plan(orders.between(t, t + horizon), None if shaft is None else shaft.between(t, t + horizon)) for t in begin
    )
    starts = Starts(rows, groups, plans)
    starts = starts.keep(begin >= time[0] + rule.history - 1e-6, f"less than {rule.history:g} s of history")
    starts = starts.keep(time[starts.rows] + horizon <= time[-1] + 1e-6, "horizon beyond the end of the log")
    return starts.keep(states["coasting"][starts.rows] == 0, "coasting at the start")


def _steady_starts(orders: Orders, time: np.ndarray, rule: Rule) -> np.ndarray:
    """Starts every `steady_every` seconds in every stretch between orders, from `steady_before` after the last order."""
    first, last, horizon = time[0] + rule.history, time[-1] - rule.horizon, rule.horizon
    changes = orders.changes(rule.order_change, 0.0)
    starts = []
    for begin, end in zip(np.append(-np.inf, changes), np.append(changes, np.inf), strict=True):
        low, high = max(begin + rule.steady_before, first), min(end - horizon, last)
        starts.append(np.arange(low, high + 1e-6, rule.steady_every))
    # Orders that creep away by small steps leave no single change: the whole stretch must stay near its first order.
    return np.array(
        [
            start
            for start in np.concatenate(starts)
            if orders.held_within(start - rule.steady_before, start + horizon, rule.order_change)
        ]
    )
