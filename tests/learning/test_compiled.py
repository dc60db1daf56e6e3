import numpy as np
import pytest
import torch

from aspnn.learning import compiled
from aspnn.learning.network import RolloutEnsemble, RolloutGru, RolloutSizes

CALM = RolloutSizes(5, 2, (3, 0, 1), 35.0, -30.0, 1.0, latent=6)
KINDS = {
    "calm": lambda: RolloutGru(CALM),
    "wind": lambda: RolloutGru(RolloutSizes(4, 1, (0, 1, 2), 35.0, -35.0, 2.0, wind=True, latent=9)),
    "no forcing": lambda: RolloutGru(RolloutSizes(3, 0, (0, 1, 2), 35.0, -35.0, 0.5, latent=4)),
    "ensemble": lambda: RolloutEnsemble(RolloutSizes(4, 1, (0, 1, 2), 1.0, -1.5, 0.2, wind=True, latent=5, members=3)),
}


def made(kind: str, seed: int = 0):
    """A network with weights and scaling of a size that bends every gate, and inputs a little beyond its scaling."""
    generator = torch.Generator().manual_seed(seed)
    network = KINDS[kind]()
    for name, value in network.state_dict().items():
        drawn = torch.randn(value.shape, generator=generator)
        value.copy_(drawn.abs() + 0.5 if name.endswith("scale") else 0.7 * drawn)
    s = network.sizes
    shapes = ((7, 12, s.inputs), (7, 21, s.forcings), (7, 2))
    return network, [3 * torch.randn(shape, generator=generator) for shape in shapes]


@pytest.mark.parametrize("kind", KINDS)
def test_the_compiled_roll_out_is_that_of_torch(kind):
    """Oracle: torch's own forward, an independent transcription. In float32 both round by about 1e-7 of the largest value a step."""
    network, inputs = made(kind)
    with torch.inference_mode():
        wanted = network(*inputs).numpy()
    found = compiled.velocities(compiled.weights_of(network), *(values.numpy().astype(float) for values in inputs))
    assert found.shape == wanted.shape
    np.testing.assert_allclose(found, wanted, atol=3e-6 * np.abs(wanted).max())


def test_gates_keep_their_limits():
    """Oracle: law. Inputs a thousand times beyond training close or open the gates wholly: finite, and as torch has it."""
    network, inputs = made("wind", 1)
    inputs[0] *= 1e3
    with torch.inference_mode():
        wanted = network(*inputs).numpy()
    found = compiled.velocities(compiled.weights_of(network), *(values.numpy() for values in inputs))
    assert np.isfinite(found).all()
    np.testing.assert_allclose(found, wanted, rtol=1e-5, atol=1e-5 * np.abs(wanted).max())


def test_a_row_does_not_depend_on_its_batch():
    """Oracle: law. Rows of several blocks, some with one past in a row, give what each gives alone, to float32 rounding.

    The same batch gives the same bits again; no rows give none.
    """
    network, inputs = made("wind", 2)
    weights, arrays = compiled.weights_of(network), [values.numpy() for values in inputs]
    rows = np.repeat(np.arange(7), 7)
    many = [values[rows] for values in arrays]
    many[1] = many[1] + 0.1 * np.random.default_rng(0).normal(size=many[1].shape)  # other plans
    assert len(rows) > 2 * compiled.BLOCK
    whole = compiled.velocities(weights, *many)
    alone = np.concatenate([compiled.velocities(weights, *(values[k : k + 1] for values in many)) for k in range(49)])
    np.testing.assert_allclose(whole, alone, atol=3e-6 * np.abs(alone).max())
    np.testing.assert_array_equal(compiled.velocities(weights, *many), whole)
    assert compiled.velocities(weights, *(values[:0] for values in many)).shape == (0, 21, 3)
