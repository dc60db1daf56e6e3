"""How late one series is against another, with the standard error of the finding."""

import numpy as np

POINTS = 300  # of the search on each side of no lag
NEEDED = 50  # samples; with fewer neither lag nor error can be told


def lag(time, values, reference_time, reference, longest: float = 15.0) -> tuple[float, float]:
    """Lag [s] of `values` at `time` against `reference` at `reference_time`, positive where values are late, and its error.

    The model is values(t) = a + b reference(t - lag) + e with b > 0, so a damped or biased sensor is matched by its shape.
    The least-squares lag within `longest` [s] either way is found by search and refined by Gauss-Newton; every lag is judged
    on the same samples, those at least `longest` inside the reference. The standard error allows for e that is correlated in
    time: the sandwich with Bartlett weights (Newey and West 1987) and the bandwidth of Andrews (1991) for a first-order
    autoregression. NaN samples are passed over; the reference is interpolated linearly and should be smooth (a filter's).

    (nan, inf) where nothing can be told: too few samples, no movement, no likeness, or the best lag lies at the end.
    """
    unknown = (float("nan"), float("inf"))
    t, y, s, g = (np.asarray(x, float) for x in (time, values, reference_time, reference))
    known = np.isfinite(s) & np.isfinite(g)
    s, g = s[known], g[known]
    if len(s) < NEEDED:
        return unknown
    inside = np.isfinite(t) & np.isfinite(y) & (t >= s[0] + longest) & (t <= s[-1] - longest)
    t, y = t[inside], y[inside]
    if len(t) < NEEDED or np.ptp(y) == 0:
        return unknown
    y = y - y.mean()

    def likeness(late: float) -> float:
        shifted = np.interp(t - late, s, g)
        shifted = shifted - shifted.mean()
        power = float(shifted @ shifted)
        return float(y @ shifted) / np.sqrt(power) if power > 0 else 0.0

    choices = np.linspace(-longest, longest, 2 * POINTS + 1)
    found = np.array([likeness(late) for late in choices])
    best = int(np.argmax(found))
    if found[best] <= 0 or best in (0, 2 * POINTS):
        return unknown
    late = float(choices[best])
    half = max(float(np.median(np.diff(s))), float(np.median(np.diff(t))))
    for _ in range(5):
        shifted, slope = (
            np.interp(t - late, s, g),
            (np.interp(t - late + half, s, g) - np.interp(t - late - half, s, g)),
        )
        J = np.column_stack([np.ones(len(t)), shifted, -slope / (2 * half)])
        (_, gain, step), _, rank, _ = np.linalg.lstsq(J, y, rcond=None)
        if rank < 3 or gain <= 0:
            return unknown
        late += float(np.clip(step / gain, -longest / POINTS, longest / POINTS))  # within a step of the search
    J[:, 2] *= gain
    inverse = np.linalg.inv(J.T @ J)
    scores = J * (y - J @ np.linalg.lstsq(J, y, rcond=None)[0])[:, None]
    return late, float(np.sqrt((inverse @ _long_run(scores) @ inverse)[2, 2]))


def _long_run(scores: np.ndarray) -> np.ndarray:
    """Covariance (k, k) of the sum of `scores` (n, k), which may be correlated along the first axis."""
    n, last = len(scores), scores[:, -1]
    rho = float(np.clip(last[1:] @ last[:-1] / (last @ last), 0.0, 0.99)) if np.any(last) else 0.0
    width = min(n // 3, int(1.1447 * (4 * rho**2 * n / ((1 - rho) ** 2 * (1 + rho) ** 2)) ** (1 / 3)))
    total = scores.T @ scores
    for k in range(1, width + 1):
        part = scores[k:].T @ scores[:-k]
        total += (1 - k / (width + 1)) * (part + part.T)
    return total
