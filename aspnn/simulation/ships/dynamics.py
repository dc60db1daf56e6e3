"""What a ship model is to the integrator: a named tuple of coefficients, and compiled `accelerations` for its type."""

from typing import Any, Protocol

# For functions that neither make nor keep arrays: numba then counts no references to the tables they read, which would take up
# to ten times as long as what they compute. An option that numba's type stubs do not list.
UNCOUNTED: dict[str, Any] = {"_nrt": False}


class Model(Protocol):
    """A ship's coefficients: a NamedTuple that compiled code takes, with `accelerations` registered for its type by numba's
    `overload`. Midship is the body's origin; x forward, y starboard, z down.
    """

    DEGREES: int  # of freedom: 3 or 6

    def balance(self, speed: float) -> tuple[float, float]:
        """Shaft speed [rev/s] and pitch ratio that hold a straight `speed` [m/s] in calm water; NaN for a pitch that is fixed."""


def accelerations(model, x, load, out):
    """out[3:6] (and, of six degrees, out[12:15]) <- time derivatives of the velocities in the state row `x` (guidance.helms).

    Velocities are those through the water. `load` (6) is the force [N] and moment [N m] at midship that wind and waves add, in
    body axes: X, Y, Z, K, M, N. Compiled code only: each model's module gives the `overload` for its type.
    """
    raise TypeError(f"accelerations of a {type(model).__name__} run in compiled code only")
