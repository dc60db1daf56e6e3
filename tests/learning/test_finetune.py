"""Fine-tuning, against its parent, a closed form of the pull, and Galilei."""

import json
from dataclasses import replace

import numpy as np
import pytest
import torch

from aspnn.frames import to_body
from aspnn.learning import fit
from aspnn.learning.card import model_card
from aspnn.learning.checkpoint import Bundle, read_bundle, write_bundle
from aspnn.learning.config import Training
from aspnn.learning.finetune import Parent, check_parent, from_the_water, taught
from aspnn.learning.servo import Identified, Servo, Servos
from aspnn.learning.train import Material, train_bundle
from aspnn.learning.windows import Windows
from aspnn.schema import InputError
from tests.learning.conftest import SPEC, nomoto_states, nomoto_windows

FACTS = {"data_sha256": "0", "training_voyages": ["new"], "validation_voyages": []}
ROLLOUT = {
    "kind": "rollout",
    "latent": 8,
    "position_tolerance_m": (0.2, 0.03),
    "heading_tolerance_deg": (0.1, 0.02),
    "velocity_tolerance_m_s": 0.05,
}
HULL = {key: value for key, value in ROLLOUT.items() if key != "latent"}
KINDS = {
    "rollout": ROLLOUT,
    "ensemble": ROLLOUT | {"members": 2},
    "thesis": {"kind": "thesis", "latent": 4, "dense": (8, 8)},
    "identified": HULL | {"kind": "identified", "ridge": 1e-3},
    "hybrid": ROLLOUT | {"kind": "hybrid", "latent": 4, "ridge": 1e-3, "ship_epochs": 1},
    "corrected": ROLLOUT | {"kind": "corrected", "latent": 4, "ridge": 1e-3},
}


def training(network: dict, **changes) -> Training:
    windows = {
        "history_s": SPEC.history,
        "horizon_s": SPEC.horizon,
        "period_s": SPEC.period,
        "inputs": SPEC.inputs,
        "forcings": SPEC.forcings,
    }
    settings = {"epochs": 2, "batch": 32, "learning_rate": 5e-3}
    data = {"name": "tuned", "data": {"logs": ("x",)}, "windows": windows, "network": network, "fit": settings}
    return Training.model_validate(data | changes)


def material(windows: Windows, **vessel) -> Material:
    facts = FACTS | {"training_windows": len(windows), "validation_windows": 0}
    return Material(replace(nomoto_states(0).vessel, **vessel), windows, None, facts)


def tuned(network: dict, windows: Windows, parent: Parent, folder, **settings) -> Bundle:
    changes = {"epochs": 4, "batch": 32, "learning_rate": 2e-3} | settings
    return train_bundle(training(network, fit=changes), material(windows), folder, quiet=True, parent=parent)


def made(network: dict, windows: Windows, folder) -> Parent:
    bundle = train_bundle(training(network, name="parent"), material(windows), folder / "run", quiet=True)
    bundle = replace(bundle, provenance=bundle.provenance | {"training_voyages": ["old"]})
    write_bundle(bundle, folder / "parent", model_card(bundle))
    return Parent.read(folder / "parent")


@pytest.fixture(scope="module")
def old() -> Windows:
    return nomoto_windows((0,)).select(np.arange(40))


@pytest.fixture(scope="module")
def new() -> Windows:
    """Windows of another boat: it gains 0.5 m/s at every start, so that its path runs ahead by that times the time."""
    windows = nomoto_windows((3,)).select(np.arange(48))
    target, path, step = windows.target.copy(), windows.path.copy(), SPEC.period
    target[:, 1:, 0] += 0.5
    for k, ahead in enumerate((np.cos(path[..., 2]), np.sin(path[..., 2]))):
        path[:, 1:, k] += 0.5 * step * np.cumsum((ahead[:, 1:] + ahead[:, :-1]) / 2, axis=1)
    return replace(windows, target=target, path=path)


@pytest.fixture(scope="module")
def parent(old, tmp_path_factory) -> Parent:
    return made(ROLLOUT, old, tmp_path_factory.mktemp("parent"))


@pytest.mark.parametrize("kind", list(KINDS))
def test_no_epochs_give_the_parent(kind, old, new, tmp_path):
    """Law: no epoch on other logs leaves every weight and every scale of the parent, so its predictions, bit by bit."""
    parent = made(KINDS[kind], old, tmp_path)
    bundle = tuned(KINDS[kind], new, parent, tmp_path / "tuned", epochs=0)
    own, other = bundle.network.state_dict(), parent.bundle.network.state_dict()
    assert own.keys() == other.keys()
    for name, values in own.items():
        assert torch.equal(values, other[name]), name
    inputs = [fit.tensor(a) for a in (new.history, new.forcing, new.wind)]
    with torch.inference_mode():
        assert torch.equal(bundle.network(*inputs), parent.bundle.network(*inputs))


@pytest.mark.parametrize("kind", ["rollout", "hybrid"])
def test_a_few_epochs_lower_the_loss_on_the_new_logs(kind, old, new, tmp_path):
    """Oracle: the squared error of the velocities falls, the parent's stays as it was: the tuned network is a copy."""
    parent = made(KINDS[kind], old, tmp_path)

    def error(network) -> float:
        with torch.inference_mode():
            found = network(*(fit.tensor(a) for a in (new.history, new.forcing, new.wind)))
        return float((found - fit.tensor(new.target)).square().mean())

    before = error(parent.bundle.network)
    bundle = tuned(KINDS[kind], new, parent, tmp_path / "tuned", epochs=8)
    assert error(bundle.network) < 0.95 * before
    assert error(parent.bundle.network) == before
    for name, values in bundle.network.named_buffers():
        assert torch.equal(values, dict(parent.bundle.network.named_buffers())[name]), name


def test_the_pull_is_geometric(parent):
    """Oracle: without a gradient the distance to the start shrinks by 1 - rate x pull a step: here (1 - 0.1 x 2)^3 = 0.512."""
    network = parent.bundle.network
    settings = fit.FitSettings(epochs=1, learning_rate=0.1, towards_parent=2.0)
    begun = [p.detach().clone() for p in network.parameters()]
    task = fit._Task(network, fit.thesis_loss(0), settings, fit._Shuffle(1, 1, 0), fit._Shuffle(0, 1, 0))
    optimizer = task.configure_optimizers()
    with torch.no_grad():
        for weights in network.parameters():
            weights.add_(1.0)
            weights.grad = torch.zeros_like(weights)
    for _ in range(3):
        optimizer.step()
    for weights, start in zip(network.parameters(), begun, strict=True):
        torch.testing.assert_close(weights.detach() - start, torch.full_like(start, 0.512), rtol=1e-4, atol=1e-5)
        weights.data.copy_(start)


def test_pulled_weights_stay_nearer(parent, new, tmp_path):
    """Law: with the pull the weights end nearer to the parent's than without."""

    def way(name, pull):
        bundle = tuned(ROLLOUT, new, parent, tmp_path / name, towards_parent=pull)
        pairs = zip(bundle.network.parameters(), parent.bundle.network.parameters(), strict=True)
        return sum(float((a - b).detach().square().sum()) for a, b in pairs)

    assert way("pulled", 100.0) < 0.5 * way("free", 0.0)


def test_a_killed_run_goes_on_towards_the_same_parent(parent, new, tmp_path):
    """Oracle: two epochs and then four are four in one go, though the second call begins at weights that have moved."""
    once = tuned(ROLLOUT, new, parent, tmp_path / "once", towards_parent=20.0)
    tuned_folder = tmp_path / "twice"

    def stop(title, row):
        if row["epoch"] == 1:
            raise KeyboardInterrupt

    told = training(ROLLOUT, fit={"epochs": 4, "batch": 32, "learning_rate": 2e-3, "towards_parent": 20.0})
    with pytest.raises(KeyboardInterrupt):
        train_bundle(told, material(new), tuned_folder, quiet=True, parent=parent, hear=stop)
    twice = train_bundle(told, material(new), tuned_folder, quiet=True, parent=parent)
    for a, b in zip(once.network.parameters(), twice.network.parameters(), strict=True):
        assert torch.equal(a, b)


def test_the_parent_is_recorded(parent, new, tmp_path):
    """Law: config and card name the parent and its hash; what it was calibrated to is gone; its voyages count as taught."""
    calibrated = Parent(replace(parent.bundle, calibration={"facts": {}}, choice={"facts": {}}), parent.model_sha256)
    bundle = tuned(ROLLOUT, new, calibrated, tmp_path / "run")
    write_bundle(bundle, tmp_path / "checkpoint", model_card(bundle))
    config = json.loads((tmp_path / "checkpoint/config.json").read_text())
    assert config["provenance"]["parent"]["model_sha256"] == parent.model_sha256
    assert "calibration" not in config and "choice" not in config
    card = (tmp_path / "checkpoint/MODEL_CARD.md").read_text()
    assert f"| fine-tuned from | parent of {parent.bundle.vessel.name} (SHA-256 {parent.model_sha256[:12]})" in card
    assert "--from parent`" in card
    assert taught(read_bundle(tmp_path / "checkpoint")) == ["new", "old"]
    low, high = bundle.domain["surge"]
    assert low <= parent.bundle.domain["surge"][0] and high >= float(new.history[..., 0].max())


@pytest.mark.parametrize(
    "change, named",
    [
        ({"network": KINDS["identified"]}, "network.kind is identified, that of checkpoint parent is rollout"),
        ({"network": ROLLOUT | {"members": 3}}, "network.kind is ensemble"),
        ({"network": ROLLOUT | {"latent": 16}}, "network.latent is 16, that of checkpoint parent is 8"),
        ({"windows": {"horizon_s": 40.0}}, "windows.horizon is 40.0, that of checkpoint parent is 60.0"),
        ({"windows": {"inputs": (*SPEC.inputs, "yaw_rate")}}, "windows.inputs is surge, sway_bow, sway_stern"),
    ],
)
def test_another_network_is_refused(parent, change, named):
    """Law: one line names the key that differs, and both values."""
    told = training(ROLLOUT).model_dump()
    for section, values in change.items():
        told[section] = values if section == "network" else told[section] | values
    with pytest.raises(InputError, match=named) as error:
        check_parent(Training.model_validate(told), parent.bundle)
    assert "\n" not in str(error.value)


def test_another_hull_is_refused(parent, new, tmp_path):
    """Law: another name is another boat of the hull; another length is another hull, named with both lengths."""
    told = training(ROLLOUT, fit={"epochs": 0})
    named = train_bundle(told, material(new, name="sister"), tmp_path / "a", quiet=True, parent=parent)
    assert named.vessel.name == "sister"
    with pytest.raises(InputError, match="vessel long: length 140 m, checkpoint parent was trained with"):
        train_bundle(told, material(new, name="long", length=140.0), tmp_path / "b", quiet=True, parent=parent)


@pytest.mark.parametrize(
    "settings, named", [({"epochs": 0}, "fit.epochs"), ({"epochs": 1, "towards_parent": 1.0}, "fit.towards_parent")]
)
def test_what_only_fine_tuning_knows_needs_a_parent(new, tmp_path, settings, named):
    """Law: without a parent both are refused, with the remedy."""
    with pytest.raises(InputError, match=f"{named} is of fine-tuning; name a parent with --from"):
        train_bundle(training(ROLLOUT, fit=settings), material(new), tmp_path, quiet=True)


def test_servos_that_logs_do_not_tell_are_the_parents(parent):
    """Law: a found servo is the boat's own; one that is the vessel file's for want of orders is the parent's."""
    found, file = Identified(Servo(0.5), Servo(0.01), 20), Identified(Servo(0.4), None, 1)
    own = Parent(replace(parent.bundle, servos=Servos(Identified(Servo(0.3), Servo(0.01), 90))), "")
    assert own.servos(Servos(found)) == Servos(found)
    assert own.servos(Servos(file)) == own.bundle.servos


def test_from_the_water_it_is_the_same_voyage():
    """Law (Galilei): a voyage set adrift and seen from the water is the voyage; accelerations are the derivatives of what is seen."""
    states, flow = nomoto_states(1), np.array([0.6, -0.8])
    ahead, athwart = to_body(*flow, states["heading_rad"])
    time, table = states["time_s"], states.table.copy()
    table["north_m"] += flow[0] * (time - time[0])
    table["east_m"] += flow[1] * (time - time[0])
    table["surge_m_s"] += ahead
    for name in ("sway_m_s", "sway_bow_m_s", "sway_stern_m_s"):
        table[name] += athwart
    table["surge_acceleration_m_s2"] += np.gradient(ahead, time)
    table["sway_acceleration_m_s2"] += np.gradient(athwart, time)
    seen = from_the_water(replace(states, table=table), flow)
    for name in ("north_m", "east_m", "surge_m_s", "sway_m_s", "sway_bow_m_s", "sway_stern_m_s"):
        np.testing.assert_allclose(seen[name], states[name], atol=1e-9, err_msg=name)
    np.testing.assert_allclose(seen["drift_rad"], np.arctan2(-states["sway_m_s"], states["surge_m_s"]), atol=1e-9)
    for name in ("surge_acceleration_m_s2", "sway_acceleration_m_s2"):  # differences over two epochs of a smooth turn
        np.testing.assert_allclose(seen[name], states[name], atol=2e-3, err_msg=name)
