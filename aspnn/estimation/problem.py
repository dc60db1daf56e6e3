"""Estimation problems as arrays: what a model makes of a log, and what both engines consume."""

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri

from aspnn.estimation.models import ONE_STEP, MotionModel, Scheme, Sigma

MISSING, USED, REJECTED, REACQUIRED, DOUBTED = range(5)  # the fate of a measurement block at an epoch
COASTING = 2.0  # s without an accepted value before the filter counts as coasting
REJECTIONS = 3  # in a row, and none accepted for COASTING seconds: the filter gives in to what it is told
AGAIN = 4.0  # s: who has to give in twice within this time has not only the place wrong, but its rate
OUTLIER = 1e-3  # probability that a good fix or heading lies beyond its gate
GLITCH = 1e-9  # the same of sensors that lie beside the point less often than the model does: yaw rate, acceleration


def gate(probability: float) -> tuple[float, float]:
    """Largest NIS of one and of two rows that passes a gate which good values fail with `probability` (chi-square)."""
    return float(chdtri(1, probability)), float(chdtri(2, probability))


OPEN = (math.inf, math.inf)  # the gate that everything passes


@dataclass(frozen=True)
class Outliers:
    """What becomes of a value beyond its gate: with an infinite `factor` it is left out, else used with R times `factor`.

    `threshold`: beyond it any component of a gated innovation is an outlier, whatever its NIS. `spread`: the later blocks of
    that epoch are doubted too. Paper IV's rule is Outliers(1000, threshold=2 m, spread=True) with open gates (E36).
    """

    factor: float = math.inf
    threshold: float = math.inf
    spread: bool = False


@dataclass(frozen=True)
class Problem:
    """x[k] = F[k] x[k-1] + N(0, Q[k]) and z[k, b] = H[k, b] x[k] + N(0, R[k, b]); d states, n epochs, b blocks.

    A block holds one or two rows that one sensor measures together; a row without a value is NaN in `z`. States are
    ordered so that each is driven by later ones: F (n, d, d) is upper triangular, F[0] and Q[0] lead from `x0`, `P0` to
    the first epoch. H (n, b, 2, d) is zero outside the columns `span` (b, 2). `angle` (b) marks blocks whose first row is
    an angle (E28: its innovation is the smallest signed angle).

    `gates` (b, 2) are the largest NIS accepted of one and of two rows; blocks of one `group` (b) stand for each other: when
    all of a group have been rejected for too long, the variance of the states marked by `place` (b, d) is raised by the
    squared offset, and the value is accepted. When that happens again within AGAIN seconds, the variance of the states
    marked by `rate` (b, d) is raised too, by the square of the offset over the time in which it has grown.
    """

    time: np.ndarray
    x0: np.ndarray
    P0: np.ndarray
    F: np.ndarray
    Q: np.ndarray
    H: np.ndarray
    span: np.ndarray
    z: np.ndarray
    R: np.ndarray
    angle: np.ndarray
    gates: np.ndarray
    group: np.ndarray
    place: np.ndarray
    rate: np.ndarray
    outliers: Outliers = Outliers()


@dataclass(frozen=True)
class ModelProblem:
    """dx = f(x) dt + noise between epochs and z[k, b] = h(x[k]) + N(0, R[k, b]) by a MotionModel; as Problem where not said.

    `given` (n, 3): heading, yaw rate, yaw acceleration at the epochs, for models of six states. `sensors` (b) are of kernels'
    POSITION to ACCELERATION, `stations` (b, 2) [m] from the point that the states describe. `inflation` (n) multiplies the
    process noise of the step that ends at each epoch. `sigma` None is the extended filter, else the unscented one.
    """

    time: np.ndarray
    x0: np.ndarray
    P0: np.ndarray
    model: MotionModel
    given: np.ndarray
    sensors: np.ndarray
    stations: np.ndarray
    inflation: np.ndarray
    z: np.ndarray
    R: np.ndarray
    angle: np.ndarray
    gates: np.ndarray
    group: np.ndarray
    place: np.ndarray
    rate: np.ndarray
    outliers: Outliers = Outliers()
    scheme: Scheme = ONE_STEP
    sigma: Sigma | None = None


@dataclass(frozen=True)
class Carry:
    """A filter between two blocks of a log: state and covariance, and by group of sensors the last time a value was accepted, how
    many have been rejected since, and when the filter last gave in to one.
    """

    time: float
    x: np.ndarray
    P: np.ndarray
    last: np.ndarray
    rejections: np.ndarray
    given_in: np.ndarray
