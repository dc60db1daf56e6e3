"""Guidance: helms (callables from time and state to a rudder order), routes, guidance laws and autopilots.

Depends on estimation, orders, angles and schema, never on a simulator.
"""

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
