"""What a ship model is to the integrator: a named tuple of coefficients, and compiled `accelerations` for its type."""

from collections.abc import Callable
from typing import Any, Protocol

from numba.extending import overload

# For functions that neither make nor keep arrays: numba then counts no references to the tables they read, which would take up
# to ten times as long as what they compute. An option that numba's type stubs do not list.
UNCOUNTED: dict[str, Any] = {"_nrt": False}


class Model(Protocol):
    """A ship's coefficients: a NamedTuple that compiled code takes, with accelerations `register`ed for its type.

    Midship is the body's origin; x forward, y starboard, z down.
    """

    DEGREES: int  # of freedom: 3 or 6

    def balance(self, speed: float) -> tuple[float, float]:
        """Shaft speed [rev/s] and pitch ratio that hold a straight `speed` [m/s] in calm water; NaN for a pitch that is fixed."""


def accelerations(model, x, load, out):
    """out[3:6] (and, of six degrees, out[12:15]) <- time derivatives of the velocities in the state row `x` (guidance.helms).

    Velocities are those through the water. `load` (6) is the force [N] and moment [N m] at midship that wind and waves add, in
    body axes: X, Y, Z, K, M, N. Compiled code only: each model's module `register`s its own.
    """
    raise TypeError(f"accelerations of a {type(model).__name__} run in compiled code only")


INLINE: Any = {"forceinline": True, "error_model": "numpy", **UNCOUNTED}


def register(kind: type, compiled: Callable) -> None:
    """Let `compiled` be the accelerations of models of the NamedTuple class `kind`."""

    @overload(accelerations, jit_options=INLINE)
    def chosen(model, x, load, out):
        if getattr(model, "instance_class", None) is kind:
            return lambda model, x, load, out: compiled(model, x, load, out)
        return None
