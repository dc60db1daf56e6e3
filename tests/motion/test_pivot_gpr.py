"""The pivot point by a Gaussian process, few samples: against the equations of Paper VI by hand, the exact one, a Monte Carlo."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from aspnn.motion.pivot import Z_95, Motion
from aspnn.motion.pivot_gpr import SHIFT, Angular, PivotGpr, Printed, enumerate_samples, sways
from aspnn.schema import InputError

BOW, STERN = 3.2, -3.2
SAMPLES = enumerate_samples(BOW, STERN, seed=1, count=16)
FORMS = {"printed": Printed(), "thesis": Printed(infinity=None), "angular": Angular(BOW, STERN)}


@pytest.fixture(scope="module")
def fitted() -> dict[str, PivotGpr]:
    return {name: PivotGpr.fit(form, SAMPLES, seed=2, subset=200, restarts=0) for name, form in FORMS.items()}


def motions(count: int, seed: int = 3) -> Motion:
    """Like those of a boat: pivot point from 4 m abaft to 12 m ahead of midship, turning at 2 to 15 deg/s either way."""
    draw = np.random.default_rng(seed)
    yaw_rate = np.radians(draw.uniform(2, 15, count)) * draw.choice([-1, 1], count)
    return Motion(-yaw_rate * draw.uniform(-4, 12, count), yaw_rate)


def covariance(g: PivotGpr, one, two) -> np.ndarray:
    """Paper VI (14) without the noise, by loops over the two inputs."""
    square = sum(((one[:, None, d] - two[None, :, d]) / g.lengths[d]) ** 2 for d in range(2))
    return g.signal**2 * np.exp(-0.5 * square)


def data(g: PivotGpr) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Inputs, targets and variances of the noise of the samples that `g` was fitted on."""
    targets, known = g.form.targets(SAMPLES.place)
    kept = np.isfinite(targets[:, 0])
    return g.form.inputs(SAMPLES.sway, SAMPLES.yaw_rate)[kept], targets[kept], known[kept] + g.noise**2


@pytest.mark.parametrize("name", FORMS)
def test_process_is_that_of_the_paper(fitted, name):
    """Independent transcription of Paper VI (15): k* K^-1 y and k** - k* K^-1 k*, and what each form makes of them."""
    g, m = fitted[name], motions(40)
    inputs, targets, noise = data(g)
    across = covariance(g, g.form.inputs(m.sway, m.yaw_rate), inputs)
    inverse = np.linalg.inv(covariance(g, inputs, inputs) + np.diag(noise))
    mean = across @ inverse @ targets
    variance = g.signal**2 - np.einsum("ij,jk,ik->i", across, inverse, across) + g.noise**2
    found = g(m)
    if name == "angular":
        q = np.arctan2(mean[:, 1], mean[:, 0]) / 2
        sd = np.sqrt(variance / 4 / (mean**2).sum(axis=1) + (SHIFT * np.cos(q) ** 2 / BOW) ** 2)
        expected = BOW * np.tan(q), BOW / np.cos(q) ** 2 * sd
        ends = [np.where(np.abs(q + k * sd) < np.pi / 2, BOW * np.tan(q + k * sd), np.nan) for k in (-Z_95, Z_95)]
    else:
        expected = mean[:, 0], np.sqrt(variance)
        ends = [expected[0] + k * expected[1] for k in (-Z_95, Z_95)]
    np.testing.assert_allclose(found.place, expected[0], rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(found.sd, expected[1], rtol=1e-5)
    bounded = np.isfinite(ends[0]) & np.isfinite(ends[1])
    assert bounded.mean() > 0.5
    np.testing.assert_allclose(found.low[bounded], ends[0][bounded], rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(found.high[bounded], ends[1][bounded], rtol=1e-5, atol=1e-5)
    np.testing.assert_array_equal(g.mean(m.sway, m.yaw_rate), found.place)


def test_hyperparameters_are_the_likeliest(fitted):
    """Law of a maximum: the marginal likelihood, written by hand, is lower at every hyperparameter 5 % away."""
    whole = PivotGpr.fit(FORMS["angular"], SAMPLES, seed=2, subset=len(SAMPLES.place), restarts=0)

    def likelihood(g):
        inputs, targets, noise = data(g)
        K = covariance(g, inputs, inputs) + np.diag(noise)
        return -0.5 * np.sum(targets * np.linalg.solve(K, targets)) - np.linalg.slogdet(K)[1]

    best = likelihood(whole)
    for factor in (0.95, 1.05):
        one, two = whole.lengths
        for change in (
            {"signal": whole.signal * factor},
            {"lengths": (one * factor, two)},
            {"lengths": (one, two * factor)},
        ):
            assert likelihood(replace(whole, **change)) < best
    assert likelihood(replace(whole, noise=whole.noise + 0.01)) < best  # it may lie at zero
    assert whole.lengths != fitted["angular"].lengths  # the subset is in use


def test_samples_are_the_enumeration_of_the_paper():
    """Paper VI 4.3: 100 sways within 5 m/s, denser near zero in a constant ratio, all pairs; places of v + r x = 0 and noise of 0.1 m."""
    side = sways()
    assert len(side) == 100 and side[-1] == 5.0 and np.all(np.diff(side) > 0)
    np.testing.assert_allclose(side, -side[::-1], atol=1e-15)
    np.testing.assert_allclose(side[-1] / side[-2], np.exp(6 * 2 / 99), rtol=1e-4)
    samples = enumerate_samples(BOW, STERN, seed=0)
    assert len(samples.place) == 10_000
    stations = {(b, s) for b, s in np.round(samples.sway[:, None] + samples.yaw_rate[:, None] * [BOW, STERN], 9)}
    assert stations == {(b, s) for b in np.round(side, 9) for s in np.round(side, 9)}
    turning = samples.yaw_rate != 0
    assert (~turning).sum() == 100 and np.all(samples.place[~turning] == np.inf)
    noise = samples.place[turning] + samples.sway[turning] / samples.yaw_rate[turning]
    np.testing.assert_allclose(noise.std(), SHIFT, rtol=4 / np.sqrt(2 * 9900))
    assert abs(noise.mean()) < 4 * SHIFT / np.sqrt(9900)


def test_infinity_is_cut_left_out_or_an_ordinary_point():
    """Definitions (E38): 1000 m as Paper VI, no sample as the thesis; on the circle of the angular form it is (-1, 0)."""
    place = np.array([2.0, np.inf])
    np.testing.assert_array_equal(Printed().targets(place)[0][:, 0], [2.0, 1000.0])
    np.testing.assert_array_equal(Printed(infinity=None).targets(place)[0][:, 0], [2.0, np.nan])
    targets, known = Angular(BOW, STERN).targets(place)
    np.testing.assert_allclose(targets[1], [-1, 0], atol=1e-15)
    np.testing.assert_allclose(known[1], 0, atol=1e-30)
    np.testing.assert_allclose(
        np.sqrt(known[0]), 2 * SHIFT * BOW / (BOW**2 + 4)
    )  # d(2 atan(x / h)) = 2 h dx / (h^2 + x^2)


def test_interval_covers_the_exact_pivot_point(fitted):
    """Statistic on 2,000 motions that were not enumerated: 95 % by the mean's own interval; places within a third of a metre."""
    m = motions(2000)
    place = -m.sway / m.yaw_rate
    g = fitted["angular"]
    for way in (g, replace(g, of_mean=True)):
        found = way(m)
        assert np.mean((found.low <= place) & (place <= found.high)) >= 0.95
        assert np.median(found.high - found.low) < 2.5
    assert np.median(np.abs(g(m).place - place)) < 0.33
    assert np.median(g(m).sd) > np.median(replace(g, of_mean=True)(m).sd)


def test_errors_of_the_motion_go_through_the_process(fitted):
    """Monte Carlo of the mean, 20,000 draws of small correlated errors: 1 / sqrt(2 n) = 0.5 %, so 2 % is four of them."""
    draw = np.random.default_rng(4)
    v, r, sd_v, sd_r, c = -0.5, 0.15, 1e-3, 3e-4, 2e-7
    one, two = draw.standard_normal((2, 20_000))
    yaw_rate = r + c / sd_v * one + np.sqrt(sd_r**2 - (c / sd_v) ** 2) * two
    g = fitted["angular"]
    spread = g.mean(v + sd_v * one, yaw_rate).std()
    with_errors, without = g(Motion(v, r, sd_v, sd_r, c)).sd, g(Motion(v, r)).sd
    np.testing.assert_allclose(np.sqrt(with_errors**2 - without**2), spread, rtol=0.02)


@pytest.mark.parametrize("name", FORMS)
def test_undefined_and_unbounded(fitted, name):
    """Definitions: NaN without turning, any shape kept; an interval that holds infinity is the whole line, never a wild one."""
    found = fitted[name](Motion(np.full((2, 2), 0.3), [[0.0, 0.0029], [0.0031, -0.2]], 0.02, 1e-3))
    for values in found:
        np.testing.assert_array_equal(np.isnan(values), [[True, True], [False, False]])
    assert np.isnan(fitted[name](Motion(0.3, 0.0)).place)
    if name == "angular":
        assert (found.low[1, 0], found.high[1, 0]) == (-np.inf, np.inf)
    assert np.all(found.low[1] < found.high[1]) and np.isfinite(found.low[1, 1])


def test_what_cannot_be_learnt_is_named():
    """Definition: the refusals name what to give."""
    with pytest.raises(InputError, match="even"):
        enumerate_samples(BOW, STERN, seed=0, count=15)
    few = type(SAMPLES)(*(values[:5] for values in SAMPLES))
    with pytest.raises(InputError, match="too few"):
        PivotGpr.fit(Printed(), few, seed=0)


def test_scikit_learn_waits_until_a_fit():
    """Fact: importing the module, and the package, leaves scikit-learn alone."""
    code = "import sys, aspnn, aspnn.motion.pivot_gpr; print('sklearn' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "False\n"
