"""Small voyages and windows for the learning tests: the evaluation tests' Nomoto ship, 20 minutes each."""

import numpy as np
import pytest

from aspnn.learning.windows import Sampling, Windows, WindowSpec, concatenate, make_windows, starts
from aspnn.records import States
from tests.evaluation.conftest import nomoto_voyage

SPEC = WindowSpec(20.0, 60.0, 2.0, ("surge", "sway_bow", "sway_stern", "rudder_angle"), ("rudder_angle",))


def nomoto_states(seed: int) -> States:
    """States of a Nomoto voyage, sways at the stations filled in."""
    states = nomoto_voyage(seed).states
    for name, x in zip(("sway_bow_m_s", "sway_stern_m_s"), states.vessel.sway_stations, strict=True):
        states.table[name] = states["sway_m_s"] + x * states["yaw_rate_rad_s"]
    return states


def nomoto_windows(seeds, spec=SPEC, sampling=Sampling(sliding=20.0)) -> Windows:  # noqa: B008
    """Windows of some voyages, labels from the states themselves (they have no noise)."""
    parts = [nomoto_states(seed) for seed in seeds]
    return concatenate([make_windows(s, s, spec, starts(s, spec, sampling)) for s in parts])


@pytest.fixture(scope="session")
def windows() -> Windows:
    return nomoto_windows((0, 1))


@pytest.fixture(scope="session")
def states() -> States:
    return nomoto_states(0)


def assert_windows_equal(a: Windows, b: Windows) -> None:
    assert (a.spec, a.voyages) == (b.spec, b.voyages)
    for name in ("history", "forcing", "target", "path", "wind", "start", "voyage"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
