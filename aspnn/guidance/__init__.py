"""Guidance: helms, which are callables from time and state to a rudder order. Depends on orders only, never on a simulator."""

from aspnn.guidance.helms import (
    Helm,
    held_orders,
    random_orders,
    straight,
    turning_circle,
    williamson_turn,
    zigzag,
)

__all__ = ["Helm", "held_orders", "random_orders", "straight", "turning_circle", "williamson_turn", "zigzag"]
