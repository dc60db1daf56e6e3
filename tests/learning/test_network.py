"""The networks against motion.path, hand-written gates, published sizes, and the laws that a forecast keeps."""

from dataclasses import asdict, replace

import numpy as np
import pytest
import torch

from aspnn.learning.checkpoint import build
from aspnn.learning.network import (
    Affine,
    RolloutEnsemble,
    RolloutGru,
    RolloutSizes,
    ThesisGru,
    ThesisSizes,
    flat_range,
    path_of,
)
from aspnn.motion import integrate, two_station_motion

SIZES = RolloutSizes(inputs=4, forcings=1, now=(0, 1, 2), x_bow=35.0, x_stern=-35.0, period=1.0, wind=True, latent=8)


@pytest.fixture
def network() -> RolloutGru:
    torch.manual_seed(0)
    network = RolloutGru(SIZES)
    network.motion.set(torch.tensor([2.0, -1, -1]), torch.tensor([6.0, 1, 1]))
    for layer in (network.out, network.direct, network.correct):
        torch.nn.init.normal_(layer.weight, std=0.3)
    return network.eval()


@pytest.fixture
def batch():
    generator = torch.Generator().manual_seed(1)
    draw = lambda *shape: torch.randn(shape, generator=generator)  # noqa: E731
    return draw(5, 7, 4), draw(5, 21, 1), draw(5, 2)


def test_torch_path_is_the_exact_rigid_step():
    """Oracle: motion.integrate with each step's mean velocities, in float64."""
    generator = torch.Generator().manual_seed(2)
    velocities = torch.randn(3, 40, 3, generator=generator, dtype=torch.float64)
    found = path_of(velocities, 0.7, 30.0, -40.0).numpy()
    mean = (velocities[:, 1:] + velocities[:, :-1]).numpy() / 2
    sway, yaw_rate = two_station_motion(mean[..., 1], mean[..., 2], 30.0, -40.0)
    path = integrate(np.zeros(3), np.stack([mean[..., 0], sway, yaw_rate], -1), 0.7)
    np.testing.assert_allclose(found, np.stack([path.north, path.east, path.heading], -1), atol=1e-12)


def test_motion_and_velocities_are_inverse(network):
    velocities = torch.tensor([[5.0, 0.4, -0.8]])
    torch.testing.assert_close(network.to_velocities(network.to_motion(velocities)), velocities)


def test_rollout_is_causal(network, batch):
    """Law: what is ordered after step k moves nothing before it, and does move what follows."""
    history, forcing, wind = batch
    later = forcing.clone()
    later[:, 12:] += 1.0
    with torch.inference_mode():
        a, b = network(history, forcing, wind), network(history, later, wind)
    assert torch.equal(a[:, :12], b[:, :12])
    assert (a[:, 12:] != b[:, 12:]).any(dim=-1).all()


def test_a_batch_is_its_rows(network, batch):
    """Law: a window's prediction does not depend on its neighbours in the batch (float32 rounding apart)."""
    with torch.inference_mode():
        together = network(*batch)
        alone = torch.cat([network(*(part[k : k + 1] for part in batch)) for k in range(5)])
    torch.testing.assert_close(together, alone, rtol=1e-5, atol=1e-5)


def test_wind_turns_with_the_predicted_heading(batch):
    """Law: a hull that does not turn feels the same wind for ever; one that turns by pi feels it reversed.

    The network is made transparent: velocities change by the forward wind alone, and the yaw rate is set by the start.
    """
    network = RolloutGru(SIZES)
    for layer in (network.out, network.direct, network.correct):
        torch.nn.init.zeros_(layer.weight)
    network.direct.weight.data[0, -2] = 1.0  # forward wind drives surge
    history = torch.zeros(2, 7, 4)
    turn = np.pi / 20 * 70 / 2
    history[1, -1, 1], history[1, -1, 2] = turn, -turn  # pi within 20 steps of 1 s
    with torch.inference_mode():
        surge = network(history, torch.zeros(2, 21, 1), torch.tensor([[3.0, 0], [3.0, 0]]))[..., 0]
    gained = np.diff(surge.numpy(), axis=1) / network.CHANGE
    np.testing.assert_allclose(gained[0], 3.0, rtol=1e-5)
    np.testing.assert_allclose(gained[1], 3.0 * np.cos(np.pi / 20 * np.arange(20)), atol=1e-4)


def test_cell_is_the_gru_of_paper_v_with_gates_exchanged(network):
    """Oracle: Paper V (15-18) by hand, with PyTorch's z for 1 - z and r o (U h + b) for U (r o h) (erratum E42)."""
    x, h = torch.randn(1, 3 + 2 + 2), torch.randn(1, 8)
    w, u, b, c = (getattr(network.cell, n).detach() for n in ("weight_ih", "weight_hh", "bias_ih", "bias_hh"))
    gates_x, gates_h = (x @ w.T + b).chunk(3, 1), (h @ u.T + c).chunk(3, 1)
    reset, update = torch.sigmoid(gates_x[0] + gates_h[0]), torch.sigmoid(gates_x[1] + gates_h[1])
    new = torch.tanh(gates_x[2] + reset * gates_h[2])
    torch.testing.assert_close(network.cell(x, h), (1 - update) * new + update * h)


def test_thesis_network_has_the_published_sizes():
    """Paper V, table 6: dense 240 and 120, 900 outputs, three networks; weights counted from the sizes."""
    network, latent = ThesisGru(ThesisSizes(inputs=10)), 64
    gru = 3 * latent * (10 + latent + 2)
    dense = 240 * (latent + 1) + 120 * (240 + 1) + 900 * (120 + 1)
    assert sum(p.numel() for p in network.parameters()) == 3 * (gru + dense)
    with torch.inference_mode():
        assert network(torch.zeros(2, 300, 10), torch.zeros(2, 901, 0), torch.zeros(2, 2)).shape == (2, 901, 3)


def test_affine_maps_the_extremes_and_leaves_constants():
    """Paper V (20): the smallest value becomes -1, the largest 1; a constant feature is only shifted."""
    values = torch.tensor([[1.0, 7.0], [3.0, 7.0], [2.5, 7.0]])
    affine = Affine(2)
    affine.set(*flat_range(values))
    torch.testing.assert_close(affine(values), torch.tensor([[-1.0, 0], [1.0, 0], [0.5, 0]]))
    torch.testing.assert_close(affine.undo(affine(values)), values)


def test_ensemble_is_the_mean_of_its_members(batch):
    """Law: the ensemble's velocities are the members' mean, and its weights load into an ensemble of the same sizes."""
    torch.manual_seed(3)
    ensemble = RolloutEnsemble(replace(SIZES, members=3)).eval()
    with torch.inference_mode():
        each = [member(*batch) for member in ensemble.members]
        torch.testing.assert_close(ensemble(*batch), (each[0] + each[1] + each[2]) / 3)
        assert not torch.equal(each[0], each[1])
        other = build("ensemble", asdict(ensemble.sizes)).eval()
        other.load_state_dict(ensemble.state_dict())
        assert torch.equal(other(*batch), ensemble(*batch))
