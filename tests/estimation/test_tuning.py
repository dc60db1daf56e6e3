"""Maximum likelihood finds the noise that the data were made with."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from aspnn.estimation.tuning import tune_noise
from aspnn.records import Log
from aspnn.schema import InputError
from aspnn.vessel import Noise, load_vessel

TRUE = Noise(position=0.3, heading=0.004, yaw_rate=0.0005, acceleration=0.02, jerk_density=4e-6, yaw_jerk_density=3e-9)


def made_log(seed: int, n: int = 6000, dt: float = 0.1) -> Log:
    """A log of motion driven by white jerk of the densities of TRUE, by fine Euler steps, noise of TRUE added."""
    rng, fine = np.random.default_rng(seed), 10
    h, steps = dt / fine, n * fine

    def driven(density, start):
        """Acceleration, rate and place of a white-jerk chain at the epochs, (3, steps)."""
        a = np.cumsum(np.sqrt(density * h) * rng.standard_normal(steps))
        rate = start + np.concatenate([[0], np.cumsum((a[1:] + a[:-1]) / 2 * h)])
        return a, rate

    _, r = driven(TRUE.yaw_jerk_density, 0.0)
    psi = np.concatenate([[0], np.cumsum((r[1:] + r[:-1]) / 2 * h)])
    (a_u, u), (a_v, v) = driven(TRUE.jerk_density, 5.0), driven(TRUE.jerk_density, 0.0)
    velocity = np.exp(1j * psi) * (u + 1j * v)
    place = np.concatenate([[0], np.cumsum((velocity[1:] + velocity[:-1]) / 2 * h)])
    rows = slice(0, None, fine)
    noise = {name: rng.standard_normal((4, n)) for name in ("a", "b")}
    table = {
        "time_s": np.arange(n) * dt,
        "midship_north_m": place.real[rows] + TRUE.position * noise["a"][0],
        "midship_east_m": place.imag[rows] + TRUE.position * noise["a"][1],
        "heading_deg": np.degrees(psi[rows] + TRUE.heading * noise["a"][2]) % 360,
        "yaw_rate_deg_s": np.degrees(r[rows] + TRUE.yaw_rate * noise["a"][3]),
        "acceleration_surge_m_s2": (a_u - v * r)[rows] + TRUE.acceleration * noise["b"][0],
        "acceleration_sway_m_s2": (a_v + u * r)[rows] + TRUE.acceleration * noise["b"][1],
    }
    return Log(pd.DataFrame(table), load_vessel("cargo90"))


def test_likelihood_finds_the_noise():
    """Oracle: the noise the log was made with. Sensors within 3 % (6000 samples: sd 0.9 %), densities within a half."""
    vessel = replace(load_vessel("cargo90"), noise=Noise())
    found = tune_noise([made_log(1)], vessel, sensors=True)
    for name in ("position", "heading", "yaw_rate", "acceleration"):
        assert getattr(found, name) == pytest.approx(getattr(TRUE, name), rel=0.03), name
    assert found.jerk_density == pytest.approx(TRUE.jerk_density, rel=0.5)
    assert found.yaw_jerk_density == pytest.approx(TRUE.yaw_jerk_density, rel=0.5)


def test_no_log_is_said():
    with pytest.raises(InputError, match="no log"):
        tune_noise([], load_vessel("cargo90"))
