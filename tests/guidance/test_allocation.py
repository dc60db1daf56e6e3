"""Control allocation against the matrix of the paper, brute force at the limits, and the paper's own shortcoming."""

import numpy as np
import pytest

from aspnn.guidance.allocation import Propellers, allocate, allocate_many, given, most_moment
from aspnn.simulation.ships.otter import Otter
from aspnn.vessel import load_vessel

OTTER = Propellers(arm=0.395, k_pos=0.01108, k_neg=0.006445, ahead=119.682, astern=66.708)


def test_within_the_limits_it_is_the_inverse_of_the_papers_matrix():
    """Oracle: (61)-(63) of paper 001 with numpy's inverse, both propellers running ahead."""
    k, arm = OTTER.k_pos, OTTER.arm
    B = k * np.array([[1, 1], [arm, -arm]])  # -l1 = 0.395, -l2 = -0.395
    demands = np.array([[100.0, 5.0], [60.0, -10.0], [30.0, 0.5], [150.0, 12.0]])
    u = np.linalg.solve(B, demands.T)
    assert (u > 0).all()
    found = allocate_many(OTTER, demands[:, 0], demands[:, 1])
    np.testing.assert_allclose([found.port, found.starboard], np.sqrt(u), rtol=1e-12)
    assert not found.saturated.any()


def test_what_is_asked_is_given_in_both_directions_of_thrust():
    """Oracle: law, T(n(T)) = T: speeds found, force and moment come back, reversed propellers too; shapes are kept."""
    rng = np.random.default_rng(1)
    force, moment = rng.uniform(-60, 100, (4, 50)), rng.uniform(-12, 12, (4, 50))
    found = allocate_many(OTTER, force, moment)
    assert (found.port < 0).any() and (found.starboard < 0).any() and found.port.shape == (4, 50)
    np.testing.assert_allclose(found.surge_force, force, atol=1e-9)
    np.testing.assert_allclose(found.yaw_moment, moment, atol=1e-9)
    assert not found.saturated.any()


def test_at_the_limits_the_moment_is_held_and_the_surge_force_is_the_nearest():
    """Oracle: brute force over all pairs of thrusts, first the nearest moment, among those the nearest surge force."""
    ahead, astern = OTTER.ahead, OTTER.astern
    grid = np.linspace(-astern, ahead, 401)
    port, starboard = np.meshgrid(grid, grid)
    forces, moments = port + starboard, OTTER.arm * (port - starboard)
    step = grid[1] - grid[0]
    for force, moment in ((300.0, 10.0), (-200.0, 20.0), (239.0, 40.0), (0.0, 90.0), (100.0, -60.0), (-133.0, -1.0)):
        found = allocate_many(OTTER, force, moment)
        short = np.abs(moments - moment)
        among = short <= short.min() + 1e-9 + OTTER.arm * step
        best = np.abs(forces - force)[among].min()
        assert abs(float(found.yaw_moment) - moment) <= short.min() + 1e-9
        assert abs(float(found.surge_force) - force) <= best + 2 * step
        assert bool(found.saturated)


def test_the_most_moment_is_where_saturation_begins():
    """Oracle: just below it nothing is cut, just above it something is; at no surge force it is what two astern thrusts give."""
    assert most_moment(OTTER, 0.0) == pytest.approx(2 * 0.395 * 66.708, rel=1e-12)
    for force in (-100.0, 0.0, 40.0, 100.0, 200.0):
        limit = most_moment(OTTER, force)
        assert not allocate_many(OTTER, force, 0.999 * limit).saturated
        assert allocate_many(OTTER, force, 1.001 * limit).saturated
    assert most_moment(OTTER, 239.364) == pytest.approx(0.0, abs=1e-9)


def test_the_papers_single_constant_gives_a_reversing_propeller_58_percent():
    """Oracle: k_neg / k_pos = 0.582 of the astern thrust asked, so the surge force is too large and the moment too small."""
    paper = OTTER._replace(k_neg=OTTER.k_pos)
    speeds = allocate(paper, 0.0, 20.0)
    force, moment = given(OTTER, *speeds)
    assert moment == pytest.approx(20.0 * (1 + 0.006445 / 0.01108) / 2, rel=1e-12)
    assert force == pytest.approx(20.0 / 0.395 / 2 * (1 - 0.006445 / 0.01108), rel=1e-12)


def test_the_simulated_otter_is_a_pair_of_propellers():
    """Contract: the ship's model serves as `Propellers`, and gives what its own constants say."""
    model = Otter.of(load_vessel("otter"))
    pair = Propellers(model.arm, model.k_pos, model.k_neg, model.ahead, model.astern)
    assert pair == pytest.approx(OTTER, rel=1e-12)
    assert allocate(model, 80.0, -7.0) == allocate(pair, 80.0, -7.0)
