"""A linear time-varying estimation problem as arrays: what a model makes of a log, and what both engines consume."""

from dataclasses import dataclass

import numpy as np

MISSING, USED, REJECTED, REACQUIRED = 0, 1, 2, 3  # the fate of a measurement block at an epoch
COASTING = 2.0  # s without an accepted value before the filter counts as coasting


@dataclass(frozen=True)
class Problem:
    """x[k] = F[k] x[k-1] + N(0, Q[k]) and z[k, b] = H[k, b] x[k] + N(0, R[k, b]); d states, n epochs, b blocks.

    A block holds one or two rows that one sensor measures together; a row without a value is NaN in `z`. States are
    ordered so that each is driven by later ones: F (n, d, d) is upper triangular, F[0] and Q[0] lead from `x0`, `P0` to
    the first epoch. H (n, b, 2, d) is zero outside the columns `span` (b, 2). `angle` (b) marks blocks whose first row is
    an angle (E28: its innovation is the smallest signed angle), `gated` (b) those a chi-square gate guards; they come
    first. When all gated values have been rejected for too long, the variances of the states marked by `place` (d) and
    `rate` (d) are raised by the squared offset and by its square per time squared, and the value is accepted.
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
    gated: np.ndarray
    place: np.ndarray
    rate: np.ndarray
