"""Units that recorded logs come in, and their factors to the units of the canonical log."""

import math

from aspnn import schema

DEGREE = math.degrees(1.0)

# canonical unit -> unit as recorded -> what a recorded number is multiplied by
UNITS: dict[str, dict[str, float]] = {
    "s": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "min": 60.0, "h": 3600.0},
    "deg": {"deg": 1.0, "rad": DEGREE},
    "deg/s": {"deg/s": 1.0, "deg/min": 1 / 60, "rad/s": DEGREE},
    "m": {"m": 1.0, "km": 1e3, "ft": 0.3048, "nmi": 1852.0},
    "m/s": {"m/s": 1.0, "kn": 1852 / 3600, "km/h": 1 / 3.6},
    "m/s2": {"m/s2": 1.0, "g": 9.80665},
    "rev/s": {"rps": 1.0, "rpm": 1 / 60, "rad/s": 1 / (2 * math.pi)},
    "-": {"-": 1.0, "%": 0.01},
}


def units_of(column: str) -> dict[str, float]:
    """The units that a canonical column may be recorded in, with their factors."""
    return next(UNITS[c.unit] for c in schema.LOG if c.matches(column))
