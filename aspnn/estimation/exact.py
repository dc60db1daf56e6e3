"""The two motion models of the cascade, as linear time-varying problems.

CAA (constant angular acceleration): heading, yaw rate, yaw acceleration. CTRA (constant turn rate and acceleration) at
midship: north, east, surge, sway and the time derivatives of surge and sway, given heading and yaw rate. White noise
acts on the highest derivative alone and is discretised exactly (E34: the printed Q is that over dt).
"""

import numpy as np
from numba import njit

from aspnn.estimation.measurements import Measurements
from aspnn.estimation.problem import GLITCH, OUTLIER, Carry, Problem, gate
from aspnn.instruments import Noise

_ROOTS, _GAUSS = np.polynomial.legendre.leggauss(6)
_NODES, _WEIGHTS = (_ROOTS + 1) / 2, _GAUSS / 2  # Gauss-Legendre on [0, 1]
_BASIS = np.linalg.inv(np.vander(_NODES, increasing=True))  # (power, node): monomials of the Lagrange polynomials
_POWERS = np.arange(6)
_ORDERS = np.array([[4, 3, 2], [3, 2, 1], [2, 1, 0]])  # of dt in white_jerk, less one
# _AFTER[j, m]: integral over s in [s_j, 1] of (s - s_j) times the Lagrange polynomial of node m
_AFTER = (
    (1 - _NODES[:, None] ** (_POWERS + 2)) / (_POWERS + 2)
    - _NODES[:, None] * (1 - _NODES[:, None] ** (_POWERS + 1)) / (_POWERS + 1)
) @ _BASIS


def moments(theta, bend=0.0):
    """M_k = integral over s in [0, 1] of s^k exp(i (theta s + bend s^2)), k = 0, 1: (2, ...), regular at no turn.

    By Gauss-Legendre with 6 nodes: to 1e-15 for turns below 1 rad, 1e-7 for 5 rad.
    """
    phase = np.multiply.outer(_NODES, theta) + np.multiply.outer(_NODES**2, bend)
    wave = np.exp(1j * phase)
    return np.stack([np.tensordot(_WEIGHTS * _NODES**k, wave, 1) for k in range(2)])


def white_jerk(dt, density):
    """Covariance (..., 3, 3) of place, rate and acceleration after `dt` [s] of white noise of `density` on the jerk (E34).

    density [dt^5/20, dt^4/8, dt^3/6; dt^4/8, dt^3/3, dt^2/2; dt^3/6, dt^2/2, dt].
    """
    dt = np.asarray(dt, float)[..., None]
    powers = np.cumprod(np.broadcast_to(dt, (*dt.shape[:-1], 5)), axis=-1)  # dt to dt^5
    return powers[..., _ORDERS] * (density / np.array([[20, 8, 6], [8, 3, 2], [6, 2, 1]]))


def heading_problem(m: Measurements, noise: Noise, speed: float, length: float, before: Carry | None = None) -> Problem:
    """CAA on [heading, yaw rate, yaw acceleration] from compass and yaw rate (thesis 3.40-3.41, corrected: E14, E34).

    The state is the grid heading, continuous; the measured one is true heading less grid convergence. The filter starts
    from the first heading with variances as wide as a ship of `length` [m] at `speed` [m/s] allows: on a linear model that
    is the least-squares fit of the first samples, and needs no look ahead. `before` is how the run over the block of the log
    before ended; this block goes on from there.

    A record that is tau late tells the state at t - tau, which is that at t taken back, less what the noise w did meanwhile:
    z = H Phi(-tau) x - H Phi(-tau) w + v. Heading: row [1, -tau, tau^2/2], density tau^5/20 more variance; yaw rate: row
    [0, 1, -tau], density tau^3/3 more. Neglected: the correlation of w with x (and of the w of records less than tau
    apart). R is then too large, never too small; it is far below a sensor's own noise for delays under a few seconds.
    """
    n, pace = len(m.time), speed / length
    dt = np.diff(m.time, prepend=m.time[0] if before is None else before.time)
    F = np.zeros((n, 3, 3))
    F[:, 0, 0] = F[:, 1, 1] = F[:, 2, 2] = 1.0
    F[:, 0, 1] = F[:, 1, 2] = dt
    F[:, 0, 2] = dt**2 / 2
    late, slow = m.calibration.heading_delay, m.calibration.yaw_rate_delay
    H = np.zeros((n, 2, 2, 3))
    H[:, 0, 0] = [1.0, -late, late**2 / 2]
    H[:, 1, 0] = [0.0, 1.0, -slow]
    z = np.full((n, 2, 2), np.nan)
    z[:, 0, 0], z[:, 1, 0] = m.heading - m.calibration.heading_offset, m.yaw_rate
    heading = noise.heading**2 + white_jerk(late, noise.yaw_jerk_density)[0, 0]
    yaw_rate = noise.yaw_rate**2 + white_jerk(slow, noise.yaw_jerk_density)[1, 1]
    R = np.broadcast_to([[[heading, 0], [0, 1.0]], [[yaw_rate, 0], [0, 1.0]]], (n, 2, 2, 2)).copy()
    first = m.heading[np.argmax(np.isfinite(m.heading))] if np.isnan(m.first_heading) else m.first_heading
    return Problem(
        time=m.time,
        x0=np.array([first - m.calibration.heading_offset, 0.0, 0.0]) if before is None else before.x,
        P0=np.diag([1.0, (10 * pace) ** 2, pace**4]) if before is None else before.P,
        F=F,
        Q=white_jerk(dt, noise.yaw_jerk_density),
        H=H,
        span=np.array([[0, 3 if late else 1], [1, 3 if slow else 2]]),
        z=z,
        R=R,
        angle=np.array([True, False]),
        gates=np.array([gate(OUTLIER), gate(GLITCH)]),
        group=np.arange(2),
        place=np.eye(2, 3),
        rate=np.eye(2, 3, k=1),
    )


@njit(cache=True, error_model="numpy")
def _path(psi, r, turn, dt, nodes, weights, after):
    """How midship moves over `dt` [s], forward or back, from heading `psi`, yaw rate `r` and yaw acceleration `turn`.

    As complex numbers: what a unit of velocity and a unit of acceleration add to the place; what unit white jerk leaves in
    place-place (real), place-velocity and place-acceleration.
    """
    nodes_n = len(nodes)
    wave = np.empty(nodes_n, np.complex128)
    theta, bend = r * dt, turn * dt**2 / 2
    m0, m1 = 0j, 0j
    for i in range(nodes_n):
        phase = psi + (theta + bend * nodes[i]) * nodes[i]
        wave[i] = complex(np.cos(phase), np.sin(phase))
        m0 += weights[i] * wave[i]
        m1 += weights[i] * nodes[i] * wave[i]
    # A unit impulse of jerk at s dt moves midship by g until the end of the step.
    pp, pv, pa = 0.0, 0j, 0j
    for i in range(nodes_n):
        g = 0j
        for j in range(nodes_n):
            g += after[i, j] * wave[j]
        pp += weights[i] * (g.real**2 + g.imag**2)
        pv += weights[i] * (1 - nodes[i]) * g
        pa += weights[i] * g
    return m0 * dt, m1 * dt**2, pp, pv, pa


@njit(cache=True, error_model="numpy")
def _transition(time, heading, density, nodes, weights, after, F, Q):
    """Fill F and Q of the CTRA problem; `heading` (n, 3) holds heading, yaw rate, yaw acceleration."""
    for k in range(len(time)):
        dt = time[k] - time[k - 1] if k else 0.0
        start = heading[max(k - 1, 0)]
        m0, m1, pp, pv, pa = _path(start[0], start[1], start[2], dt, nodes, weights, after)
        pp, pv, pa = density * dt**5 * pp, density * dt**4 * pv, density * dt**3 * pa
        for i in range(6):
            F[k, i, i] = 1.0
        F[k, 0, 2] = F[k, 1, 3] = m0.real
        F[k, 1, 2], F[k, 0, 3] = m0.imag, -m0.imag
        F[k, 0, 4] = F[k, 1, 5] = m1.real
        F[k, 1, 4], F[k, 0, 5] = m1.imag, -m1.imag
        F[k, 2, 4] = F[k, 3, 5] = dt
        Q[k, 0, 0] = Q[k, 1, 1] = pp
        Q[k, 0, 2] = Q[k, 2, 0] = Q[k, 1, 3] = Q[k, 3, 1] = pv.real
        Q[k, 1, 2] = Q[k, 2, 1] = pv.imag
        Q[k, 0, 3] = Q[k, 3, 0] = -pv.imag
        Q[k, 0, 4] = Q[k, 4, 0] = Q[k, 1, 5] = Q[k, 5, 1] = pa.real
        Q[k, 1, 4] = Q[k, 4, 1] = pa.imag
        Q[k, 0, 5] = Q[k, 5, 0] = -pa.imag
        Q[k, 2, 2] = Q[k, 3, 3] = density * dt**3 / 3
        Q[k, 2, 4] = Q[k, 4, 2] = Q[k, 3, 5] = Q[k, 5, 3] = density * dt**2 / 2
        Q[k, 4, 4] = Q[k, 5, 5] = density * dt


def transition(time, heading, density: float) -> tuple[np.ndarray, np.ndarray]:
    """F and Q (n, 6, 6) of CTRA over the steps that end at `time` (n), from zero time before the first.

    `heading` (n, 3): heading [rad], yaw rate, yaw acceleration at the epochs; over a step the heading runs on as
    psi + r s + r' s^2 / 2 from its start. With e = exp(i psi(s)), place' = e (u + i v), (u + i v)' = a, a' = white noise of
    `density` [m2/s5] on both axes. Regular at zero turn rate.
    """
    n = len(time)
    F, Q = np.zeros((n, 6, 6)), np.zeros((n, 6, 6))
    _transition(time, heading, density, _NODES, _WEIGHTS, _AFTER, F, Q)
    return F, Q


@njit(cache=True, error_model="numpy")
def _measurement(values, heading, covariance, stations, position, acceleration, late, slow, z, H, R):
    """Fill z, H and R of the CTRA problem from `values` (n, b, 2): fixes, then accelerations. H comes as zeros.

    `late` and `slow` are the delays of fixes and accelerations: heading, yaw rate and their variances are taken back by them.
    """
    n, blocks = values.shape[0], values.shape[1]
    for k in range(n):
        psi, r, turn, P = heading[k, 0], heading[k, 1], heading[k, 2], covariance[k]
        psi -= late * r - late**2 / 2 * turn
        c, s = np.cos(psi), np.sin(psi)
        r -= slow * turn
        row, turned = (1.0, -late, late**2 / 2), 0.0  # variance of the heading of the fixes
        for i in range(3):
            for j in range(3):
                turned += row[i] * row[j] * P[i, j]
        for b in range(blocks):
            x, y = stations[b, 0], stations[b, 1]
            if b < blocks - 1:
                north, east = c * x - s * y, s * x + c * y
                z[k, b, 0], z[k, b, 1] = values[k, b, 0] - north, values[k, b, 1] - east
                H[k, b, 0, 0] = H[k, b, 1, 1] = 1.0
                # d(north, east) / d psi = (-east, north)
                first, second, common, variance = -east, north, position, turned
            else:
                z[k, b, 0] = values[k, b, 0] + turn * y + r * r * x
                z[k, b, 1] = values[k, b, 1] - turn * x + r * r * y
                H[k, b, 0, 4] = H[k, b, 1, 5] = 1.0
                H[k, b, 0, 3], H[k, b, 1, 2] = -r, r
                H[k, b, 0, 5], H[k, b, 1, 4] = slow * r, -slow * r
                # d(forward, starboard) / d r' = (-y, x)
                first, second, common, variance = -y, x, acceleration, P[2, 2]
            R[k, b, 0, 0] = common + variance * first * first
            R[k, b, 1, 1] = common + variance * second * second
            R[k, b, 0, 1] = R[k, b, 1, 0] = variance * first * second


@njit(cache=True, error_model="numpy")
def _taken_back(heading, density, late, nodes, weights, after, fixes, H, R):
    """Let the rows of the first `fixes` blocks tell the place `late` seconds ago, with the noise of that time in R."""
    for k in range(len(heading)):
        m0, m1, pp, _, _ = _path(heading[k, 0], heading[k, 1], heading[k, 2], -late, nodes, weights, after)
        for b in range(fixes):
            H[k, b, 0, 2] = H[k, b, 1, 3] = m0.real
            H[k, b, 1, 2], H[k, b, 0, 3] = m0.imag, -m0.imag
            H[k, b, 0, 4] = H[k, b, 1, 5] = m1.real
            H[k, b, 1, 4], H[k, b, 0, 5] = m1.imag, -m1.imag
            R[k, b, 0, 0] += density * late**5 * pp
            R[k, b, 1, 1] += density * late**5 * pp


def motion_problem(
    m: Measurements,
    noise: Noise,
    heading: np.ndarray,
    covariance: np.ndarray,
    speed: float,
    length: float,
    before: tuple[Carry, Carry] | None = None,
) -> Problem:
    """CTRA at midship on [north, east, surge, sway, surge acceleration, sway acceleration], all antennas and the IMU.

    `heading` (n, 3) and `covariance` (n, 3, 3) are those of CAA. An antenna at (X, Y) measures place + exp(i psi) (X + i Y)
    (thesis 3.38, one filter at midship: E7, E8); accelerometers at (X, Y) read a_u - v r - r' Y - r^2 X and
    a_v + u r + r' X - r^2 Y (E1, E5). What the errors of psi and r' do over the lever arms is added to R (E18): nothing beside
    fixes of 1 m, but with fixes of 2 cm it brings the mean NIS from 2.3 to 1.9. The error of r in u r is left out: nothing
    beside a gyro; without one the deviation of sway comes out half too small. Positions are about the origin of `m`.

    Records that are tau late tell the state at t - tau, as in `heading_problem`: the place is taken back along the turning
    path, to a heading of psi - r tau + r' tau^2 / 2; surge and sway are taken back by tau times their derivatives. What the
    jerk did meanwhile is added to R: for accelerations density (tau + r^2 tau^3 / 3), of which the second part is left out.

    `before` is how CAA and CTRA ended over the block of the log before.
    """
    n, blocks = len(m.time), len(m.fixes) + 1
    values = np.stack([*m.fixes.values(), m.acceleration], axis=1)
    stations = np.array([m.stations[name] for name in (*m.fixes, "imu")])
    z, H, R = np.empty((n, blocks, 2)), np.zeros((n, blocks, 2, 6)), np.empty((n, blocks, 2, 2))
    late, slow = m.calibration.position_delay, m.calibration.acceleration_delay
    variances = noise.position**2, noise.acceleration**2 + noise.jerk_density * slow
    _measurement(values, heading, covariance, stations, *variances, late, slow, z, H, R)
    if late:
        _taken_back(heading, noise.jerk_density, late, _NODES, _WEIGHTS, _AFTER, blocks - 1, H, R)
    time, path = m.time, heading
    if before is not None:  # the step into the block begins at the heading where the one before ended
        time, path = np.concatenate([[before[0].time], time]), np.vstack([before[0].x, path])
    F, Q = transition(time, path, noise.jerk_density)
    start = [1e4 * noise.position**2 + length**2, (10 * speed) ** 2, (speed**2 / length) ** 2]
    return Problem(
        time=m.time,
        x0=np.zeros(6) if before is None else before[1].x,
        P0=np.diag(np.repeat(start, 2)) if before is None else before[1].P,
        F=F[-n:],
        Q=Q[-n:],
        H=H,
        span=np.array([[0, 6 if late else 2]] * (blocks - 1) + [[2, 6]]),
        z=z,
        R=R,
        angle=np.zeros(blocks, bool),
        gates=np.array([gate(OUTLIER)] * (blocks - 1) + [gate(GLITCH)]),
        group=np.array([0] * (blocks - 1) + [1]),
        place=np.array([[1.0, 1, 0, 0, 0, 0]] * (blocks - 1) + [[0, 0, 0, 0, 1.0, 1]]),
        rate=np.array([[0, 0, 1.0, 1, 0, 0]] * (blocks - 1) + [[0.0] * 6]),
    )
