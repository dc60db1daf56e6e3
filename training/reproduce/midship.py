"""What papers I and II share: one antenna, compass, gyro and IMU at midship, drawn anew around a true voyage.

The papers' ship lay in a closed bridge simulator; cargo90, made to the dimensions of their cargo ship, stands in for it. The
heading is true to grid here: convergence is the subject of paper III.
"""

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy.optimize import minimize

from aspnn.angles import compass, difference
from aspnn.estimation import compiled
from aspnn.estimation.compiled import Run, run_batch
from aspnn.estimation.exact import heading_problem, motion_problem
from aspnn.estimation.measurements import Measurements
from aspnn.estimation.models import ONE_STEP, Cmm, Ctra, Scheme, Sigma
from aspnn.estimation.nonlinear import model_problem, two_point_start
from aspnn.estimation.problem import OPEN, ModelProblem
from aspnn.guidance.helms import Helm, held_orders, random_orders
from aspnn.instruments import Noise
from aspnn.simulation.ship import Ship
from aspnn.simulation.voyage import Voyage, simulate
from aspnn.vessel import load_vessel

VESSEL = load_vessel("cargo90")
SHIP = Ship.of(VESSEL)
SIZE = VESSEL.service_speed, VESSEL.length
SPEED = 11.43 * 1852 / 3600  # m/s, Paper II 5.1
SHAFT, PITCH = SHIP.model.balance(SPEED)
# R of Paper II, table 3 (its gyro is ten times sharper than that of the later papers)
NOISE = replace(VESSEL.noise, position=1.0, heading=math.radians(0.5), yaw_rate=math.radians(1e-3), acceleration=0.01)
# Q of Paper II, table 3, as listed and in the order of the states [p, p, v, v, psi, r, a, a] (E24)
PRINTED = (1e-1, 1e-1, 1e-3, 1e-3, 1e-5, 1e-5, math.radians(1e-1), math.radians(1e-5))
PERMUTED = (*PRINTED[:4], *PRINTED[6:], *PRINTED[4:6])
MANOEUVRE = 0.1  # m/s2, deviation of the accelerations at the start (E27)
BATCH = 10  # runs held in memory at once
TUNING = 101, 3, 900.0  # seed, number and length [s] of the voyages of random orders that `tuned` tunes on


def sail(helm: Helm, heading: float, duration: float) -> Voyage:
    """The voyage of cargo90 from a straight course of `heading` [rad] at the papers' speed, in calm water."""
    return simulate(SHIP, helm, SHIP.start(0.0, 0.0, heading, SPEED), duration)[0]


def draws(voyage: Voyage, runs: int, seed: int) -> Iterator[Measurements]:
    """Measurements of the voyage with noise drawn anew; run j draws from SeedSequence(seed, spawn_key=(j,)) alone.

    The compass reads 0 to 2 pi, as it does on board.
    """
    n, u, v, r = len(voyage.time), voyage.surge, voyage.sway, voyage.yaw_rate
    place = np.column_stack([voyage.north, voyage.east])
    felt = np.column_stack([voyage.surge_rate - v * r, voyage.sway_rate + u * r])  # E1
    for j in range(runs):
        noise = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(j,))).standard_normal((6, n))
        yield Measurements(
            time=voyage.time,
            origin=np.zeros(2),
            fixes={"midship": place + NOISE.position * noise[:2].T},
            heading=compass(voyage.heading + NOISE.heading * noise[2]),
            convergence=np.zeros(n),
            yaw_rate=r + NOISE.yaw_rate * noise[3],
            acceleration=felt + NOISE.acceleration * noise[4:].T,
            stale=np.zeros(n, bool),
            stations={"midship": (0.0, 0.0), "imu": (0.0, 0.0)},
        )


def true_states(voyage: Voyage, model: Cmm | Ctra) -> np.ndarray:
    """States (n, 8) of the model along the voyage."""
    psi, r, u, v = voyage.heading, voyage.yaw_rate, voyage.surge, voyage.sway
    along, aside = voyage.surge_rate, voyage.sway_rate
    motion = (u, v)
    if isinstance(model, Cmm):
        velocity = np.exp(1j * psi) * (u + 1j * v)  # north + i east
        felt = np.exp(1j * psi) * (along - v * r + 1j * (aside + u * r))
        path = felt * np.conj(velocity) / np.abs(velocity)  # along and across the path (thesis 3.27)
        motion, along, aside = (velocity.real, velocity.imag), path.real, path.imag
    return np.column_stack([voyage.north, voyage.east, *motion, psi, r, along, aside])


def problem(
    m: Measurements, model: Cmm | Ctra, sigma: Sigma | None, scheme: Scheme = ONE_STEP, wrap: bool = True
) -> ModelProblem:
    """The papers' filter on `m` from its second epoch on: two-point start (E26, E27), nothing gated.

    Without `wrap` the innovation of the compass is a plain difference, as in Paper II. The measurements of the second epoch
    made the start, so they are not used again.
    """
    start = two_point_start(
        model, m.time[:2], m.fixes["midship"][:2], m.heading[1], m.yaw_rate[1], NOISE, np.full(2, NOISE.position**2), MANOEUVRE
    )  # fmt: skip
    p = model_problem(m, NOISE, model, *SIZE, scheme=scheme, sigma=sigma)
    z = p.z[1:].copy()
    z[0] = np.nan
    return replace(
        p, time=p.time[1:], given=p.given[1:], inflation=p.inflation[1:], z=z, R=p.R[1:], x0=start[0], P0=start[1],
        angle=p.angle & wrap, gates=np.full_like(p.gates, OPEN[0]),
    )  # fmt: skip


def runs_of(
    measured: list[Measurements], model: Cmm | Ctra, sigma: Sigma | None, **how
) -> Iterator[tuple[ModelProblem, Run]]:
    """Problems and runs, one after the other; `BATCH` of them are in memory at once."""
    for first in range(0, len(measured), BATCH):
        problems = [problem(m, model, sigma, **how) for m in measured[first : first + BATCH]]
        yield from zip(problems, run_batch(problems), strict=True)


def cascade(m: Measurements, noise: Noise) -> tuple[Run, Run]:
    """The default filters, CAA then CTRA fed by it."""
    turning = compiled.run(heading_problem(m, noise, *SIZE))
    return turning, compiled.run(motion_problem(m, noise, turning.mean, turning.covariance, *SIZE))


def cascade_states(turning: Run, moving: Run) -> np.ndarray:
    """States (n, 8) of the default filters, in the order of Ctra's."""
    return np.column_stack([moving.mean[:, :4], turning.mean[:, :2], moving.mean[:, 4:]])


def error(states: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Estimated minus true states (n, 8), the heading's as smallest signed angle."""
    off = states - truth
    off[:, 4] = difference(states[:, 4], truth[:, 4])
    return off


def tuned() -> Noise:
    """NOISE with the process noise that is most likely on other voyages: of the yaw jerk for Caa, of jerk and yaw acceleration for Ctra.

    The vessel's own was tuned with a gyro ten times less sharp, and only for the default filters.
    """
    seed, count, duration = TUNING
    measured: list[Measurements] = []
    for k in range(count):
        rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(k,)))
        orders = held_orders([random_orders(rng, duration, 35.0, 5.0)])
        measured.extend(draws(sail(orders, rng.uniform(0, 2 * math.pi), duration), 1, seed + k))

    def turning(q) -> Noise:
        return replace(NOISE, yaw_jerk_density=math.exp(q[0]))

    def moving(q) -> Noise:
        return replace(NOISE, jerk_density=math.exp(q[0]), turn_density=math.exp(q[1]))

    def turning_cost(q) -> float:
        return -sum(compiled.run(heading_problem(m, turning(q), *SIZE)).log_likelihood for m in measured)

    def moving_cost(q) -> float:
        return -sum(run.log_likelihood for _, run in runs_of(measured, Ctra.of(moving(q)), None))

    def lowest(cost, *start: float):
        return minimize(cost, np.log(start), method="Nelder-Mead", options={"xatol": 0.02, "fatol": 0.1}).x

    caa = turning(lowest(turning_cost, NOISE.yaw_jerk_density))
    return replace(
        moving(lowest(moving_cost, NOISE.jerk_density, NOISE.turn_density)), yaw_jerk_density=caa.yaw_jerk_density
    )
