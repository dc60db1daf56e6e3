"""The pivot point by Gaussian process regression (Paper VI 3.3.2): learnt from enumerated sways of bow and stern.

Nothing is measured here: -v / r is sampled, and a process learns it back. Two forms of it stand side by side, `Printed` as
the paper has it, and `Angular`, in which places far off and at infinity are ordinary points.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np

from aspnn.motion.pivot import Z_95, Motion, PivotPoint, two_station_motion
from aspnn.schema import InputError

COUNT, REACH, STEEPNESS = 100, 5.0, 6.0  # sways at each station; largest of them [m/s]; the paper prints no steepness
SHIFT = 0.1  # m, deviation of the centre of gravity that v belongs to (Paper VI 4.3)
SUBSET = 1000  # samples that the hyperparameters are sought on
RESTARTS = 2  # further searches from hyperparameters drawn within their bounds: the printed form has bad summits
CHUNK = 1000  # points predicted at once: 80 MB of covariances with 10,000 samples


class Samples(NamedTuple):
    """Enumerated motions (n) with their pivot points [m], noise included; inf where bow and stern sway alike."""

    sway: np.ndarray
    yaw_rate: np.ndarray
    place: np.ndarray


def sways(count: int = COUNT) -> np.ndarray:
    """Sways of one station [m/s], exponentially spaced within 5 m/s and symmetric: 5 sinh(6 t) / sinh(6), t from -1 to 1.

    An even `count` leaves out zero, and with it the motion that has no pivot point at all. With 100, the steps grow from 3 mm/s
    about zero to 13 % of the sway.
    """
    return REACH * np.sinh(STEEPNESS * np.linspace(-1, 1, count)) / np.sinh(STEEPNESS)


def enumerate_samples(x_bow: float, x_stern: float, seed: int, count: int = COUNT) -> Samples:
    """All pairs of sways at bow and stern (Paper VI 4.3), as motions of midship: count^2 samples.

    The seed draws the noise of 0.1 m. Raises InputError for an odd `count`, which would hold the motion without pivot point.
    """
    if count < 4 or count % 2:
        raise InputError(f"enumerate_samples: count = {count} must be even and at least 4")
    bow, stern = (side.ravel() for side in np.meshgrid(sways(count), sways(count), indexing="ij"))
    sway, yaw_rate = two_station_motion(bow, stern, x_bow, x_stern)
    turning = bow != stern
    place = np.where(turning, -sway / np.where(turning, yaw_rate, 1.0), np.inf)
    return Samples(sway, yaw_rate, place + SHIFT * np.random.default_rng(seed).standard_normal(len(place)))


class Start(NamedTuple):
    """Where the search for hyperparameters starts: deviations of signal and noise, in units of the target, and length scales."""

    signal: float
    noise: float
    lengths: tuple[float, float]


# Table 3 of Paper VI gives one length scale of [rad/s] and one of [m/s], not in the order of x = (v, r) (E35): units decide.
TABLE_3 = Start(signal=1.5, noise=1.5, lengths=(0.2, 0.02))
CIRCLE = Start(signal=0.5, noise=0.01, lengths=(1.0, 1.0))  # the targets lie on a circle of radius 1


class Form(Protocol):
    """What the process sees of a motion and of a place, and how its answer is read.

    The answer is a coordinate q of the centreline, whose errors are taken as normal; `period` is where it comes round to itself.
    """

    start: Start
    period: float

    def inputs(self, sway, yaw_rate) -> np.ndarray:
        """Inputs (n, 2) of the process."""

    def targets(self, place) -> tuple[np.ndarray, np.ndarray]:
        """Targets (n, k) of noisy places (n), NaN where a sample is left out, and the known variance (n) of their noise."""

    def coordinate(self, mean) -> tuple[np.ndarray, np.ndarray]:
        """q (n) of the process's mean (n, k), and the factor (n) from a deviation of each target to one of q."""

    def place(self, q) -> np.ndarray:
        """Place [m] at q; infinite beyond half a period."""

    def slope(self, q) -> np.ndarray:
        """dx / dq of the place x at q."""

    def shift(self, q) -> np.ndarray:
        """Known deviation of q from the shift of the centre of gravity, in units of q."""


@dataclass(frozen=True)
class Printed:
    """Paper VI as printed: the place itself over sway and yaw rate, starting values of its table 3.

    `infinity` is what an infinite place is set to: 1000 m in Paper VI; None leaves such samples out, as the thesis does (E38).
    """

    infinity: float | None = 1000.0
    start: Start = TABLE_3
    period: float = np.inf

    def inputs(self, sway, yaw_rate):
        return np.stack([sway, yaw_rate], axis=-1)

    def targets(self, place):
        far = np.nan if self.infinity is None else self.infinity
        return np.where(np.isfinite(place), place, far)[:, None], np.zeros_like(place)

    def coordinate(self, mean):
        return mean[:, 0], np.ones(len(mean))

    def place(self, q):
        return q

    def slope(self, q):
        return np.ones_like(q)

    def shift(self, q):
        return np.zeros_like(q)  # it is part of the noise that is learnt


@dataclass(frozen=True)
class Angular:
    """The same process where the map is smooth: q = atan(x / half the stations' distance) over stretched sways.

    The inputs are the sways of bow and stern on the scale on which they are evenly enumerated, asinh(v_i / s). q runs round
    when the pivot point passes infinity, so the targets are (cos 2q, sin 2q), without a jump, and no sample is left out. The noise
    of 0.1 m is known; what is learnt beside it is how far the process itself is off.
    """

    x_bow: float
    x_stern: float
    start: Start = CIRCLE
    period: float = np.pi

    @property
    def half(self) -> float:
        return abs(self.x_bow - self.x_stern) / 2

    def inputs(self, sway, yaw_rate):
        stations = np.asarray(sway)[..., None] + np.asarray(yaw_rate)[..., None] * np.array([self.x_bow, self.x_stern])
        return np.arcsinh(stations * (np.sinh(STEEPNESS) / REACH))

    def targets(self, place):
        q = np.arctan(place / self.half)
        return np.stack([np.cos(2 * q), np.sin(2 * q)], axis=-1), (2 * self.shift(q)) ** 2

    def coordinate(self, mean):
        return np.arctan2(mean[:, 1], mean[:, 0]) / 2, 0.5 / np.hypot(mean[:, 0], mean[:, 1])

    def place(self, q):
        return np.where(np.abs(q) < np.pi / 2, self.half * np.tan(q), np.copysign(np.inf, q))

    def slope(self, q):
        return self.half / np.cos(q) ** 2

    def shift(self, q):
        return SHIFT * np.cos(q) ** 2 / self.half


@dataclass(frozen=True)
class PivotGpr:
    """A fitted process, a way to the pivot point. `signal`, `noise` and `lengths` are its hyperparameters (Paper VI 14).

    The interval is that of a new value (15), so it holds `SHIFT`; with `of_mean` it is that of the pivot point of the v given.
    Errors of the motion are carried through the process to first order.
    """

    form: Form
    process: Any  # sklearn's GaussianProcessRegressor of targets / signal, with a kernel of amplitude 1
    signal: float
    noise: float
    lengths: tuple[float, float]
    of_mean: bool = False

    @classmethod
    def fit(cls, form: Form, samples: Samples, seed: int, subset: int = SUBSET, restarts: int = RESTARTS) -> "PivotGpr":
        """Hyperparameters by maximum likelihood (L-BFGS) on `subset` samples drawn by `seed`, then one exact fit on all.

        The last fit takes 16 n^2 bytes: the squared-exponential kernel has amplitude 1 and the noise lies on its diagonal, since
        scikit-learn makes a full matrix of every other term of a kernel. Raises InputError for samples that are too few.
        """
        targets, known = form.targets(samples.place)
        kept = np.isfinite(targets).all(axis=1)
        inputs, targets, known = form.inputs(samples.sway, samples.yaw_rate)[kept], targets[kept], known[kept]
        if len(inputs) < 10:
            raise InputError(f"PivotGpr: {len(inputs)} samples are too few; give at least 10")
        some = np.random.default_rng(seed).permutation(len(inputs))[:subset]
        signal, noise, lengths = _likeliest(form.start, inputs[some], targets[some], known[some], seed, restarts)
        from sklearn.gaussian_process import GaussianProcessRegressor
        from sklearn.gaussian_process.kernels import RBF

        alpha = (known + noise**2) / signal**2
        process = GaussianProcessRegressor(RBF(lengths), alpha=alpha, optimizer=None, copy_X_train=False)
        return cls(form, process.fit(inputs, targets / signal), signal, noise, lengths)

    def __call__(self, motion: Motion) -> PivotPoint:
        v, r, sd_v, sd_r, c = (np.asarray(w, float) for w in np.broadcast_arrays(*motion))
        use = motion.defined()
        found = np.full((4, *use.shape), np.nan)
        if use.any():
            found[:, use] = self._of(v[use], r[use], sd_v[use], sd_r[use], c[use])
        return PivotPoint(*found)

    def mean(self, sway, yaw_rate) -> np.ndarray:
        """Place [m] of motions (n) alone, which takes no solving of equations."""
        return self.form.place(self._coordinate(sway, yaw_rate))

    def _of(self, v, r, sd_v, sd_r, covariance) -> tuple[np.ndarray, ...]:
        q, gain, own = (np.empty(len(v)) for _ in range(3))
        for part in _chunks(len(v)):
            mean, deviation = self.process.predict(self.form.inputs(v[part], r[part]), return_std=True)
            q[part], gain[part] = self.form.coordinate(self.signal * mean.reshape(len(mean), -1))
            own[part] = self.signal * deviation.reshape(len(mean), -1)[:, 0]
        variance = (gain * own) ** 2
        if not self.of_mean:
            variance += (gain * self.noise) ** 2 + self.form.shift(q) ** 2
        # Columns of a root of the motion's covariance: one deviation of each, there and back, tells the slope of the process.
        along = np.where(sd_v > 0, covariance / np.where(sd_v > 0, sd_v, 1.0), 0.0)
        for dv, dr in ((sd_v, along), (0.0 * sd_v, np.sqrt(sd_r**2 - along**2))):
            if np.any(dv) or np.any(dr):
                variance += (self._apart(self._coordinate(v + dv, r + dr), self._coordinate(v - dv, r - dr)) / 2) ** 2
        reach = Z_95 * np.sqrt(variance)
        low, high = self.form.place(q - reach), self.form.place(q + reach)
        unbounded = np.isinf(low) | np.isinf(high)  # it holds infinity: the pivot point may lie on either side
        low, high = np.where(unbounded, -np.inf, low), np.where(unbounded, np.inf, high)
        return self.form.place(q), self.form.slope(q) * np.sqrt(variance), low, high

    def _coordinate(self, v, r) -> np.ndarray:
        q = np.empty(len(v))
        for part in _chunks(len(v)):
            mean = self.signal * self.process.predict(self.form.inputs(v[part], r[part]))
            q[part], _ = self.form.coordinate(mean.reshape(len(mean), -1))
        return q

    def _apart(self, one, two) -> np.ndarray:
        period = self.form.period
        return one - two if np.isinf(period) else (one - two + period / 2) % period - period / 2


def _chunks(count: int) -> list[slice]:
    return [slice(start, start + CHUNK) for start in range(0, count, CHUNK)]


def _likeliest(
    start: Start, inputs, targets, known, seed: int, restarts: int
) -> tuple[float, float, tuple[float, float]]:
    """Deviations of signal and noise and length scales of most likelihood, within a thousand times their starts."""
    import warnings

    from sklearn.exceptions import ConvergenceWarning
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

    def bounds(value, times):
        return value / times, value * times

    kernel = ConstantKernel(start.signal**2, bounds(start.signal**2, 1e6))
    kernel *= RBF(start.lengths, [bounds(length, 1e3) for length in start.lengths])
    kernel += WhiteKernel(start.noise**2, bounds(start.noise**2, 1e6))
    process = GaussianProcessRegressor(
        kernel, alpha=known, optimizer="fmin_l_bfgs_b", n_restarts_optimizer=restarts, random_state=seed
    )
    with (
        warnings.catch_warnings()
    ):  # a hyperparameter at a bound is a finding here (Printed has no use for an input), no fault
        warnings.simplefilter("ignore", ConvergenceWarning)
        process.fit(inputs, targets)
    signal2, *lengths, noise2 = np.exp(process.kernel_.theta)
    return float(np.sqrt(signal2)), float(np.sqrt(noise2)), (float(lengths[0]), float(lengths[1]))
