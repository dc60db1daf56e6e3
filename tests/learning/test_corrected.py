"""The corrected ship: without corrections it is its ship, what is trained is what predicts, and it learns what a ship leaves over."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from aspnn.evaluation.evaluate import sees_future
from aspnn.learning import fit
from aspnn.learning.checkpoint import read_bundle, write_bundle
from aspnn.learning.config import CorrectedNet, Cut, Data, Fit, IdentifiedNet, Training
from aspnn.learning.corrected import Taught, corrected
from aspnn.learning.identified import IdentifiedShip
from aspnn.learning.network import path_of
from aspnn.learning.train import Material, _rolled_out, identify, train_bundle
from aspnn.learning.windows import plan_of
from aspnn.prediction.gru import GruPredictor
from tests.learning.conftest import SPEC, nomoto_states, nomoto_windows
from tests.learning.test_identified import SIZES, TOLERANCES, made_up, plan

NET = CorrectedNet(kind="corrected", latent=6, ridge=1e-4, members=2, **TOLERANCES)


def inputs(steps=12) -> tuple[torch.Tensor, ...]:
    """History (2, 5, 5), forcing (2, steps + 1, 2) and wind (2, 2) of two starts, the made-up ship's."""
    rng = np.random.default_rng(1)
    history = np.concatenate([[6.0, 0.2, -0.3, 0.1, 1.5] + 0.1 * rng.normal(size=(2, 5, 5))])
    forcing = np.stack([plan(steps, 1.0), plan(steps, 1.0)[::-1]])
    return tuple(
        torch.from_numpy(np.ascontiguousarray(a)) for a in (history, forcing, np.array([[3.0, -5.0], [1.0, 4.0]]))
    )


def test_without_what_it_adds_it_is_its_ship():
    """Oracle: the ship itself, with the layers that write corrections set to zero."""
    ship = made_up()
    network = corrected(ship, 5, 2, latent=6, members=2).double()
    for member in network.members:
        for layer in (member.out, member.correct):
            torch.nn.init.zeros_(layer.weight)
    torch.testing.assert_close(network(*inputs()), ship(*inputs()), rtol=1e-5, atol=1e-5)  # weights are kept in single


def test_a_correction_is_that_of_the_start_and_a_sum_over_the_steps():
    """Oracle: the docstring's formula, with biases alone: CHANGE times (start + number of steps x period x each step's)."""
    network = corrected(made_up(), 5, 2, latent=6, members=1).double()
    member, history, (forcing, wind) = network.members[0], inputs()[0], inputs()[1:]
    for layer in (member.out, member.correct):
        torch.nn.init.zeros_(layer.weight)
    start, each = torch.tensor([[1.0, -2.0, 3.0], [0.5, 0.2, -1.0]], dtype=torch.double)
    member.correct.bias.data, member.out.bias.data = start, each
    with torch.no_grad():
        found = member(history, network.roll(history, forcing, wind), forcing)
    expected = member.CHANGE * (start + torch.arange(13.0, dtype=torch.double)[:, None] * SIZES.period * each)
    torch.testing.assert_close(found, expected.expand(2, -1, -1))


def test_the_wind_is_turned_with_the_ship():
    """Oracle: the air of a roll-out, turned back by the heading that its own velocities draw, is the wind at the start."""
    network = corrected(made_up(), 5, 2, latent=6, members=1).double()
    history, forcing, wind = inputs()
    with torch.no_grad():
        rolled, found = network.roll(history, forcing, wind), network.ship(history, forcing, wind)
    rate = (found[..., 1] - found[..., 2]) / (SIZES.x_bow - SIZES.x_stern)
    turn = torch.cat([torch.zeros(2, 1), torch.cumsum((rate[:, 1:] + rate[:, :-1]) / 2, 1)], 1)
    assert turn[:, -1].abs().min() > 0.05
    back = torch.view_as_complex(rolled[..., 3:].contiguous()) * torch.exp(1j * turn)
    torch.testing.assert_close(back, torch.view_as_complex(wind)[:, None].expand(-1, 13), rtol=1e-9, atol=1e-9)


def test_what_is_trained_is_what_predicts():
    """Oracle: the mean of the members, each as it is trained, on windows that carry the ship's roll-outs."""
    windows = nomoto_windows((0,))
    ship = identify(NET, windows, nomoto_states(0).vessel)
    network = corrected(ship, 4, 1, latent=6, members=2)
    with_rolls = _rolled_out(network, windows)
    network.scale(*(torch.from_numpy(a) for a in (windows.history, with_rolls.forcing[..., 1:], windows.forcing)))
    taught, used = (
        tuple(torch.from_numpy(getattr(w, k)) for k in ("history", "forcing", "wind")) for w in (with_rolls, windows)
    )
    with torch.no_grad():
        alone = [Taught(network, member)(*taught) for member in network.members]
        assert (alone[0] - alone[1]).abs().max() > 1e-4
        torch.testing.assert_close(network(*used), (alone[0] + alone[1]) / 2, rtol=0, atol=1e-5)
    trained, own = (list(part.parameters()) for part in (Taught(network, network.members[0]), network.members[0]))
    assert [id(weight) for weight in trained] == [id(weight) for weight in own]  # nothing of the ship


def test_learns_what_its_ship_leaves_over(tmp_path):
    """By construction: labels are the ship's own roll-outs plus a surge that grows by 0.6 m/s in 60 s; unseen voyages show it."""
    windows, unseen = nomoto_windows((0, 1)), nomoto_windows((10,))
    network = corrected(identify(NET, windows, nomoto_states(0).vessel), 4, 1, latent=6, members=1)
    rolled = _rolled_out(network, windows)
    network.scale(*(torch.from_numpy(a) for a in (windows.history, rolled.forcing[..., 1:], windows.forcing)))
    extra = torch.zeros(SPEC.horizon_steps + 1, 3)
    extra[:, 0] = 0.01 * torch.from_numpy(SPEC.time)
    sizes = network.sizes
    with torch.no_grad():
        target = network.ship.to_velocities(torch.from_numpy(rolled.forcing[..., 1:])) + extra
        path = path_of(target, sizes.period, sizes.x_bow, sizes.x_stern)
    rolled = replace(rolled, target=target.numpy(), path=path.numpy())
    loss = fit.path_loss(fit.Tolerance((0.5, 0.05), (0.01, 0.001), 0.1))
    settings = fit.FitSettings(epochs=10, batch=16, learning_rate=2e-2, one_cycle=True, clip=1.0)
    fit.fit(Taught(network, network.members[0]), loss, rolled, None, settings, tmp_path, quiet=True)
    given = [torch.from_numpy(a) for a in (unseen.history, unseen.forcing, unseen.wind)]
    with torch.no_grad():
        added = network(*given) - network.ship(*given)
    assert (added - extra).abs().max(dim=0).values.max() < 0.15


def test_a_trained_one_travels_and_does_not_see_the_future(windows, states, tmp_path):
    """Law: read back from its checkpoint it predicts the same path, and no later row of the states moves that."""
    cut = Cut(history_s=20, horizon_s=60, period_s=2, inputs=SPEC.inputs, forcings=SPEC.forcings, sliding_s=20)
    training = Training(name="made-up", data=Data(logs=("x",)), windows=cut, network=NET, fit=Fit(epochs=1))
    facts = {"data_sha256": "0", "training_voyages": [], "validation_voyages": []}
    bundle = train_bundle(training, Material(states.vessel, windows, None, facts), tmp_path / "run", quiet=True)
    assert {path.name for path in (tmp_path / "run").glob("correction-*")} == {"correction-1", "correction-2"}
    write_bundle(bundle, tmp_path / "bundle", "# card")
    read = read_bundle(tmp_path / "bundle")
    rows = np.array([400, 900])
    plans = [plan_of(states, row, SPEC.horizon) for row in rows]
    a, b = (GruPredictor(one).predict_many(states, rows, plans) for one in (bundle, read))
    np.testing.assert_array_equal(a.north, b.north)
    assert not sees_future(GruPredictor(read), states, rows, plans)


@pytest.mark.parametrize("fast", [1.0, 4.0])
def test_a_voyage_much_faster_than_most_is_no_run_away(fast):
    """By construction: one of 40 windows is `fast` times as fast, four times the root mean square. The ship's limit lies beyond it."""
    windows = nomoto_windows((0, 1))
    last = np.arange(len(windows)) == len(windows) - 1
    much = np.where(last, fast, 1.0).astype(np.float32)[:, None, None]
    history = windows.history * np.concatenate([np.repeat(much, 3, 2), np.ones_like(much)], 2)
    windows = replace(windows, history=history, target=windows.target * much)
    ship = IdentifiedShip(
        identify(IdentifiedNet(kind="identified", ridge=0.1, **TOLERANCES), windows, nomoto_states(0).vessel).sizes
    )
    ship.regress(
        *(torch.from_numpy(a) for a in (windows.target, windows.forcing, windows.wind, windows.path[..., 2])), 0.1
    )
    assert ship.limit == pytest.approx(
        max(2.0, 1.5 * float(ship.to_motion(torch.from_numpy(windows.target)).abs().max()))
    )
