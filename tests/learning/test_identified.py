"""The identified ship against scipy's integrator and its own ship from data, and the laws that it and the hybrid keep."""

from dataclasses import asdict, replace

import numpy as np
import pytest
import torch
from scipy.integrate import solve_ivp

from aspnn.evaluation.evaluate import sees_future
from aspnn.learning.card import model_card
from aspnn.learning.checkpoint import read_bundle, write_bundle
from aspnn.learning.config import Cut, Data, Fit, HybridNet, IdentifiedNet, Training
from aspnn.learning.identified import (
    AIR,
    HULL,
    PAIRS,
    RUDDER,
    TRIPLES,
    HybridGru,
    HybridSizes,
    IdentifiedShip,
    IdentifiedSizes,
)
from aspnn.learning.train import Material, identify, train_bundle
from aspnn.learning.windows import plan_of
from aspnn.prediction.gru import GruPredictor
from aspnn.schema import InputError
from tests.learning.conftest import SPEC, nomoto_states, nomoto_windows

X_BOW, X_STERN = 35.0, -30.0
SIZES = IdentifiedSizes((0, 1), (3, 4), (0, 1, 2), X_BOW, X_STERN, 1.0, wind=True)
TOLERANCES = {
    "position_tolerance_m": (0.5, 0.05),
    "heading_tolerance_deg": (0.5, 0.05),
    "velocity_tolerance_m_s": 0.1,
}
KINDS = {
    "identified": IdentifiedNet(kind="identified", ridge=1e-4, **TOLERANCES),
    "hybrid": HybridNet(kind="hybrid", latent=6, ridge=1e-4, ship_epochs=1, **TOLERANCES),
}


def place(word: str, power: int = 0) -> int:
    """The row of the weights of a hull term (1, u, v, r, PAIRS, TRIPLES) times a power of the rudder angle."""
    return ("1", "u", "v", "r", *PAIRS, *TRIPLES).index(word) * RUDDER + power


def made_up(sizes=SIZES) -> IdentifiedShip:
    """A damped ship with terms of every kind, not alike to both sides, in double precision."""
    ship = IdentifiedShip(sizes).double()
    ship.speed.fill_(6.0)
    ship.largest.copy_(torch.tensor([0.6, 2.0]))
    w = torch.zeros(ship.terms, 3, dtype=torch.double)
    w[place("1"), 0], w[place("u"), 0], w[place("uu"), 0], w[place("uu", 2), 0] = 0.012, -0.002, -0.01, -0.004
    w[place("vr"), 0], w[place("rR"), 0], w[place("vvv"), 1] = 0.03, -0.02, -0.05
    w[place("uv"), 1], w[place("ur"), 1], w[place("uu", 1), 1], w[place("1", 1), 1] = -0.06, -0.05, -0.006, -0.002
    w[place("uv"), 2], w[place("ur"), 2], w[place("uu", 1), 2], w[place("uu", 3), 2] = -0.02, -0.1, 0.02, -0.006
    w[place("rR"), 2], w[place("vV"), 2], w[place("vrr"), 2], w[place("uu"), 2] = -0.1, -0.02, -0.05, 0.0006
    if ship.shaft:
        w[HULL * RUDDER, 0], w[HULL * RUDDER + 3 * RUDDER, 2] = 0.003, -0.01  # 1 and r, with |n|
    if sizes.wind:
        w[-AIR:] = torch.linspace(-0.0004, 0.0005, 3 * AIR, dtype=torch.double).reshape(AIR, 3)
    ship.weight.data = w
    return ship


def plan(steps: int, period: float, shaft: bool = True) -> np.ndarray:
    time = np.arange(steps + 1) * period
    columns = [0.5 * np.sin(time / 9) + 0.1, 1.5 + 0.5 * np.cos(time / 14)]
    return np.stack(columns if shaft else columns[:1], -1)


def by_scipy(ship: IdentifiedShip, start, forcing, wind, period, rtol=1e-10) -> np.ndarray:
    """Motion (steps + 1, 4: u, v, r over the speed unit, heading) by an independent transcription of the docstring."""
    time = np.arange(len(forcing)) * period
    weight = (ship.whiten @ ship.weight).detach().numpy()
    unit, half = float(ship.speed), (X_BOW - X_STERN) / 2

    def rates(t, state):
        u, v, r, heading = state
        word = {"1": 1.0, "u": u, "v": v, "r": r, "U": abs(u), "V": abs(v), "R": abs(r)}
        d = np.interp(t, time, forcing[:, 0]) / 0.6
        n = np.interp(t, time, forcing[:, 1]) / 2.0 if forcing.shape[1] > 1 else 1.0
        rows = []
        for name in ("1", "u", "v", "r", *PAIRS, *TRIPLES):
            value = np.prod([word[letter] for letter in name])
            value /= np.sqrt(1 + u * u + v * v + r * r) if name in TRIPLES else 1
            rows += [value * (n**2 if name == "1" else n if len(name) == 1 else 1) * d**k for k in range(RUDDER)]
        if forcing.shape[1] > 1:
            for name in ("1", "u", "v", "r"):
                rows += [word[name] * (n if name == "1" else 1) * abs(n) * d**k for k in range(RUDDER)]
        if wind is not None:
            a = wind[0] * np.cos(heading) + wind[1] * np.sin(heading)
            b = wind[1] * np.cos(heading) - wind[0] * np.sin(heading)
            a, b = a / unit - u, b / unit - v
            rows += [a * a, a * abs(a), a * b, b * b, b * abs(b)]
        return [*(np.array(rows) @ weight), r * unit / half]

    return solve_ivp(rates, (0, time[-1]), [*start, 0.0], t_eval=time, rtol=rtol, atol=rtol / 100).y.T


@pytest.mark.parametrize("wind", [False, True])
def test_rollout_is_that_of_scipy(wind):
    """Oracle: solve_ivp on the terms written out by hand; the error falls at the order of the step (4, with wind 2)."""
    errors = []
    for steps, period in ((40, 1.0), (80, 0.5)):
        ship = made_up(replace(SIZES, period=period, wind=wind))
        forcing, start, air = plan(40, 1.0), (1.0, -0.05, 0.06), np.array([9.0, -7.0])
        forcing = np.stack([np.interp(np.arange(steps + 1) * period, np.arange(41), c) for c in forcing.T], -1)
        history = torch.zeros(1, 2, 5, dtype=torch.double)
        history[0, :, :3] = ship.to_velocities(torch.tensor(start, dtype=torch.double))
        with torch.inference_mode():
            found = ship(history, torch.tensor(forcing)[None], torch.tensor(air)[None])
            motion = ship.to_motion(found)[0].numpy()
        errors.append(np.abs(motion - by_scipy(ship, start, forcing, air if wind else None, period)[:, :3]).max())
    assert errors[0] < (1e-4 if wind else 1e-6)
    assert errors[1] < errors[0] / (3.2 if wind else 8)


def test_recovers_a_polynomial_ship_from_noise_free_voyages():
    """Oracle: the ship that made the voyages; unseen voyages are predicted to a centimetre per second after 60 s."""
    sizes = replace(SIZES, forcing=(0,), driven=(3,), wind=False)
    true, rng = made_up(sizes), np.random.default_rng(3)
    time = np.arange(61.0)
    voyages = []
    for _ in range(40):
        size, period, phase = rng.uniform(0.1, 0.6), rng.uniform(6, 25), rng.uniform(0, 6)
        forcing = size * np.sin(time / period + phase)[:, None]
        start = rng.uniform(0.5, 1.1), rng.uniform(-0.1, 0.1), rng.uniform(-0.1, 0.1)
        voyages.append((forcing, by_scipy(true, start, forcing, None, 1.0, 1e-6)))
    forcing = torch.tensor(np.stack([f for f, _ in voyages]))
    motion = torch.tensor(np.stack([m for _, m in voyages]))
    target = true.to_velocities(motion[..., :3])
    found = IdentifiedShip(sizes).double()
    found.regress(target[:30], forcing[:30], torch.zeros(30, 2), motion[:30, :, 3], 1e-12)
    history = torch.cat([target[30:, :1], forcing[30:, :1]], -1).expand(-1, 2, -1)
    with torch.inference_mode():
        error = found(history, forcing[30:], torch.zeros(10, 2)) - target[30:]
    assert error.abs().max() < 0.01
    assert (target[30:, -1] - target[30:, 0]).abs().max() > 1.0  # there was something to predict


def test_a_mirrored_ship_sails_a_mirrored_path():
    """Law: weights whose signs are changed by the parity of their terms give, of mirrored states, the mirrored motion."""
    ship, mirror = made_up(), made_up()
    mirror.largest.copy_(ship.largest)
    flip = torch.tensor([1.0, -1, -1], dtype=torch.double)
    rng = torch.Generator().manual_seed(0)
    motion = 0.3 * torch.randn(1, 4, 3, generator=rng, dtype=torch.double)
    forcing, wind = torch.tensor(plan(3, 1.0))[None], torch.tensor([[5.0, 3.0]], dtype=torch.double)
    turn = torch.zeros(1, 4, dtype=torch.double)
    opposite = forcing * torch.tensor([-1.0, 1.0])
    terms = ship.library(ship.to_velocities(motion), forcing, wind, turn)
    other = ship.library(ship.to_velocities(motion * flip), opposite, wind * flip[:2], turn)
    parity = torch.sign(terms * other)[0, 0]
    torch.testing.assert_close(other, terms * parity)
    mirror.weight.data = ship.weight * parity[:, None] * flip
    history = torch.cat([ship.to_velocities(motion), forcing], -1)
    mirrored = torch.cat([ship.to_velocities(motion * flip), opposite], -1)
    with torch.inference_mode():
        a = ship.to_motion(ship(history, forcing, wind))
        b = ship.to_motion(mirror(mirrored, opposite, wind * flip[:2]))
        unlike = ship.to_motion(ship(mirrored, opposite, wind * flip[:2]))
    torch.testing.assert_close(b, a * flip)
    assert not torch.allclose(unlike, a * flip)  # the ship itself is not alike to both sides


def test_a_slow_ship_is_a_fast_one_in_slow_motion():
    """Law: with hull, propeller and air at half the speed, forces are a quarter (the saturating cubic terms left out)."""
    ship = made_up()
    for word in TRIPLES:
        ship.weight.data[place(word) : place(word) + RUDDER] = 0
    motion = torch.tensor([[0.9, -0.1, 0.2]], dtype=torch.double)
    forcing = torch.tensor([[0.2, 1.4]], dtype=torch.double)
    air = torch.tensor([[1.1, -0.6]], dtype=torch.double)
    slow = ship.coefficients(*ship.plan(forcing * torch.tensor([1.0, 0.5])))
    whole = ship.rate(motion, ship.coefficients(*ship.plan(forcing)), air)
    torch.testing.assert_close(ship.rate(motion / 2, slow, air / 2), whole / 4)


def test_observer_trusts_what_its_gain_says():
    """Law: gain 1 gives the last filtered state; of a history that the ship could have sailed, every gain gives its end."""
    ship = made_up(replace(SIZES, wind=False))
    forcing = torch.tensor(plan(12, 1.0))[None]
    first = torch.zeros(1, 2, 5, dtype=torch.double)
    first[0, :, :3] = ship.to_velocities(torch.tensor([1.0, 0.1, -0.05], dtype=torch.double))
    rng = torch.Generator().manual_seed(1)
    with torch.inference_mode():
        history = torch.cat([ship(first, forcing, torch.zeros(1, 2)), forcing], -1)
        noisy = history.clone()
        noisy[..., :3] += 0.1 * torch.randn(1, 13, 3, generator=rng, dtype=torch.double)
        torch.testing.assert_close(ship.observe(noisy, None), ship.to_motion(noisy[:, -1, :3]))
        ship.gain.copy_(0.3 * torch.randn(3, 3, generator=rng, dtype=torch.double))
        torch.testing.assert_close(ship.observe(history, None), ship.to_motion(history[:, -1, :3]))
        assert not torch.allclose(ship.observe(noisy, None), ship.to_motion(noisy[:, -1, :3]))


def test_an_untrained_hybrid_is_its_ship():
    """Law: with nothing learned the GRU adds nothing, bit by bit; with something learned it does."""
    sizes = replace(SIZES, wind=True)
    hybrid = HybridGru(HybridSizes(5, 2, **asdict(sizes), latent=6))
    hybrid.ship.load_state_dict(made_up(sizes).state_dict())
    rng = torch.Generator().manual_seed(2)
    history, forcing, wind = (0.3 * torch.randn(4, *s, generator=rng) for s in ((7, 5), (21, 2), (2,)))
    with torch.inference_mode():
        torch.testing.assert_close(hybrid(history, forcing, wind), hybrid.ship(history, forcing, wind), rtol=0, atol=0)
        hybrid.out.bias += 1.0
        assert not torch.equal(hybrid(history, forcing, wind), hybrid.ship(history, forcing, wind))


def training(kind: str) -> Training:
    cut = Cut(history_s=20, horizon_s=60, period_s=2, inputs=SPEC.inputs, forcings=SPEC.forcings, sliding_s=20)
    fit = Fit(epochs=2, batch=16, learning_rate=2e-3, one_cycle=True, clip=1.0, seed=4)
    return Training(name="made-up", data=Data(logs=("x",)), windows=cut, network=KINDS[kind], fit=fit)


def material(windows, states) -> Material:
    facts = {"data_sha256": "0", "training_voyages": ["a"], "validation_voyages": []}
    return Material(states.vessel, windows, None, facts | {"training_windows": len(windows), "validation_windows": 0})


@pytest.mark.parametrize("kind", KINDS)
def test_training_repeats_travels_and_does_not_see_the_future(kind, windows, states, tmp_path):
    """Law: two runs are equal bit by bit, a bundle read back predicts the same, and later rows move no prediction."""
    first, second = (
        train_bundle(training(kind), material(windows.select(np.arange(40)), states), tmp_path / name, quiet=True)
        for name in "ab"
    )
    weights, again = first.network.state_dict(), second.network.state_dict()
    assert all(weights[name].isfinite().all() and torch.equal(weights[name], again[name]) for name in weights)
    write_bundle(first, tmp_path / "bundle", "# card")
    read = read_bundle(tmp_path / "bundle")
    assert read.network.sizes == first.network.sizes
    rows = np.array([400, 900])
    plans = [plan_of(states, row, SPEC.horizon) for row in rows]
    a, b = (GruPredictor(bundle).predict_many(states, rows, plans) for bundle in (first, read))
    np.testing.assert_array_equal(a.north, b.north)
    assert not sees_future(GruPredictor(read), states, rows, plans)


def test_knows_a_nomoto_ship_by_regression_alone():
    """Oracle: the Nomoto ship of the test voyages, unseen ones: heading at 60 s to a tenth of what it changes."""
    ship = identify(KINDS["identified"], nomoto_windows(range(3)), nomoto_states(0).vessel)
    unseen = nomoto_windows(range(10, 12))
    with torch.inference_mode():
        found = ship(*(torch.from_numpy(a) for a in (unseen.history, unseen.forcing, unseen.wind))).numpy()
    rate = (found[..., 1] - found[..., 2]) / (ship.sizes.x_bow - ship.sizes.x_stern)
    heading = ((rate[:, 1:] + rate[:, :-1]) / 2 * SPEC.period).sum(1)
    turned = unseen.path[:, -1, 2]
    assert np.median(np.abs(heading - turned)) < 0.1 * np.median(np.abs(turned))


def test_what_it_needs_is_named(windows, states):
    """A training file without the rudder angle is refused by the key that lacks it."""
    for key, spec in (("forcings", replace(SPEC, forcings=())), ("inputs", replace(SPEC, inputs=SPEC.inputs[:3]))):
        with pytest.raises(InputError, match=f"windows.{key}: rudder_angle is missing"):
            identify(KINDS["identified"], replace(windows, spec=spec), states.vessel)


def test_a_ship_that_runs_away_is_refused(states):
    """A fit that leaves the motions it knows and diverges is an error that names the ridge, not a network of NaN."""
    net = KINDS["identified"].model_copy(update={"ridge": 1e-6})
    with pytest.raises(InputError, match=r"network.ridge: .* runs away"):
        identify(net, nomoto_windows((0, 1)).select(np.arange(40)), states.vessel)


def test_the_ship_of_a_hybrid_learns_at_its_own_rate(windows, states, tmp_path):
    """Law: at no share of the rate it stays bit by bit what it was when it was alone, which a share moves; the model card
    lists the epochs and the losses of both."""
    some, found = windows.select(np.arange(40)), {}
    for share in (0.0, 0.5):
        net = KINDS["hybrid"].model_copy(update={"ship_share": share})
        told = training("hybrid").model_copy(update={"network": net})
        found[share] = train_bundle(told, material(some, states), tmp_path / str(share), quiet=True)
    last = torch.load(tmp_path / "0.0" / "identified" / "resume" / "last.ckpt", weights_only=True)["state_dict"]
    ships = {share: bundle.network.ship.state_dict() for share, bundle in found.items()}
    assert all(torch.equal(ships[0.0][name], last[f"network.{name}"]) for name in ships[0.0])
    assert not torch.equal(ships[0.5]["weight"], ships[0.0]["weight"])
    card = model_card(found[0.0])
    assert "1 epochs (identified), then 2 epochs (hybrid), of batches of 16" in card
    for name in ("identified", "hybrid"):
        assert f"| {name} | train | {found[0.0].provenance['curves'][name]['train_loss'][0]:.4g} |" in card
