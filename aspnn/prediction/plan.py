"""Plans as users write them: one angle, or (seconds from now, order) pairs, checked against the vessel's limits."""

import math
from collections.abc import Sequence

import numpy as np

from aspnn.orders import Orders, Plan
from aspnn.records import States
from aspnn.schema import InputError
from aspnn.vessel import Vessel

Orderable = float | Sequence[tuple[float, float]] | Orders | None


def make_plan(states: States, rudder: Orderable, shaft: Orderable, horizon: float) -> Plan:
    """A plan from the last state on. None holds the order in force; one number is held; pairs start at 0.

    `rudder` in rad, `shaft` in rev/s. Raises InputError when orders run back, lie outside the horizon or the rudder's
    limits, or when there is no order in force to hold.
    """
    angle = _orders(rudder, "rudder", horizon)
    if angle is None:
        held = states["rudder_order_rad"][-1]
        if not math.isfinite(held):
            raise InputError(f"{states.path or 'states'}: no rudder order is known at the start; give a rudder plan")
        angle = Orders.held(held)
    speed = _orders(shaft, "shaft", horizon)
    if speed is None:
        turning = states["shaft_speed_rps"][-1]
        speed = Orders.held(turning) if math.isfinite(turning) else None
    check_plan(Plan(angle, speed), states.vessel)
    return Plan(angle, speed)


def check_plan(plan: Plan, vessel: Vessel) -> None:
    """Hold a plan to the vessel's rudder limits. Raises InputError naming the order and its time."""
    over = np.abs(plan.rudder.values) > vessel.rudder_max * (1 + 1e-6)
    if over.any():
        k = int(np.argmax(over))
        raise InputError(
            f"rudder plan: order {math.degrees(plan.rudder.values[k]):.4g} deg at {plan.rudder.times[k]:g} s is beyond the "
            f"{math.degrees(vessel.rudder_max):g} deg stops of {vessel.name}"
        )


def _orders(given: Orderable, what: str, horizon: float) -> Orders | None:
    if given is None or isinstance(given, Orders):
        return given
    if isinstance(given, int | float | np.number):
        given = [(0.0, float(given))]
    times, values = (np.array([float(pair[k]) for pair in given]) for k in (0, 1))
    if len(times) == 0 or not (np.isfinite(times).all() and np.isfinite(values).all()):
        raise InputError(f"{what} plan: give at least one order, as numbers")
    if abs(times[0]) > 1e-9:
        raise InputError(f"{what} plan: the first order is at {times[0]:g} s, it must be at 0 (now)")
    if (np.diff(times) <= 0).any():
        raise InputError(
            f"{what} plan: the order at {times[1:][np.diff(times) <= 0][0]:g} s does not come after the one before it"
        )
    if times[-1] > horizon:
        raise InputError(
            f"{what} plan: the order at {times[-1]:g} s lies beyond the horizon of {horizon:g} s; leave it out"
        )
    return Orders(times, values)
