"""A row of a log from what was told about one time: of every column the value nearest to it, in the units and meanings of schema.LOG."""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from aspnn.live.clocks import Event
from aspnn.live.held import HeldOrder
from aspnn.logs.nmea import WIND_AGE, NmeaMap
from aspnn.logs.recording import TOGETHER

UNTOLD = 5.0  # s with a rudder angle and without an order after which orders are derived
Told = Sequence[tuple[float, float]]  # times [s, UNIX] and values


class Row(NamedTuple):
    """What the sensors told at `time` [s, UNIX]: columns of schema.LOG and their values; a silent sensor has none."""

    time: float
    values: dict[str, float]


class RowMaker:
    """Rows in the order of time, of the sensors of `plan`. `derived`: nobody tells rudder orders, so they are made of the angle."""

    def __init__(self, plan: NmeaMap) -> None:
        self.events: list[Event] = []  # for the owner to take
        self.derived = False
        self._plan = plan
        self.begin()

    def begin(self) -> None:
        """Forget what earlier rows told: the clock is another."""
        self._heading: tuple[float, float] = (-math.inf, math.nan)
        self._held = HeldOrder()
        self._steered = math.nan  # since when there is a rudder angle and nobody tells orders

    def make(self, point: float, values: Mapping[str, Told], ordered: bool) -> Row:
        """The row at the `point` [s, UNIX] of the grid, or at its fix; `ordered`: somebody tells rudder orders."""
        fixes = [t for a in self._plan.antennas for t, _ in values.get(f"{a}_latitude_deg", ())]
        time = min(fixes) if fixes else point
        found: dict[str, float] = {}
        headings = [self._heading, *sorted(values.get("heading_deg", ()))]
        for column, told in values.items():
            at, value = min(told, key=lambda pair: abs(pair[0] - time))
            if column == "propeller_pitch_percent":
                assert self._plan.full_pitch_ratio is not None  # else nobody is chosen to tell it
                found["propeller_pitch_ratio"] = value / 100 * self._plan.full_pitch_ratio
            elif column == "wind_angle_true_deg":  # from the bow: never with a later heading
                then, heading = max(pair for pair in headings if pair[0] <= at + TOGETHER)
                if at - then <= WIND_AGE:
                    found["wind_from_true_deg"] = (heading + value) % 360
            else:
                found[column] = value
        self._heading = headings[-1]
        for column, factor in self._plan.scale.items():
            if column in found:
                found[column] *= factor
        if "rudder_angle_deg" in found:
            self._derive(time, found, ordered or self._plan.sensors.rudder_order is not None)
        return Row(time, found)

    def _derive(self, time: float, found: dict[str, float], ordered: bool) -> None:
        """Give a row the order behind its rudder angle, where nobody has told an order for UNTOLD, nor is named to tell one."""
        if ordered:
            self._steered, self.derived = math.nan, False
            return
        order = self._held.take(time, found["rudder_angle_deg"])
        self._steered = time if not time - self._steered >= 0 else self._steered
        if time - self._steered < UNTOLD:
            return
        if not self.derived:
            text = "nobody tells rudder orders: they are derived from the rudder angle, while it moves the angle itself"
            self.events.append(Event(time, "derived", text))
            self.derived = True
        found["rudder_order_deg"] = order
