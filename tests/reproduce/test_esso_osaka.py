"""The cross-validation over the recordings: folds, regions from other folds alone, halves of a record. No recording is needed."""

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from aspnn.motion import Path as Motion
from aspnn.orders import Orders, Plan
from aspnn.records import Log
from aspnn.vessel import load_vessel

sys.path.insert(0, str(Path(__file__).parents[2] / "training/reproduce"))

import esso_osaka
import esso_osaka_regions as regions
import esso_osaka_tables as tables


def made(n=900, seed=0) -> tuple[regions.Carried, np.ndarray]:
    """Windows in six folds: Gaussian errors in course axes whose variance is 1, 0.4 and 0.1 times (1 + a driver)."""
    rng = np.random.default_rng(seed)
    driving = np.zeros((n, 1, 4))
    driving[..., 0], driving[..., 1] = 1.0, rng.uniform(0, 6, (n, 1))
    sd = np.sqrt(driving[..., :2].sum(-1, keepdims=True) * [1.0, 0.4, 0.1])
    angle = rng.uniform(0, 2 * np.pi, n)
    turn = np.zeros((n, 1, 3, 3))
    turn[:, 0, 0, 0] = turn[:, 0, 1, 1] = np.cos(angle)
    turn[:, 0, 1, 0], turn[:, 0, 0, 1] = np.sin(angle), -np.sin(angle)
    turn[..., 2, 2] = 1.0
    errors = np.einsum("...ab,...b->...a", turn, sd * rng.normal(size=(n, 1, 3)))
    return regions.Carried(errors, np.zeros((n, 1, 3, 3)), turn, driving), np.arange(n) % 6


def test_regions_hold_their_share_whatever_drives_the_errors():
    """Oracle: 95 % of Gaussian errors, in the half with small variances and in the other; 4 standard errors of 450 windows."""
    windows, fold = made()
    found = regions.cross_conformal(windows, fold, np.zeros(len(fold), bool))
    driver = windows.driving[:, 0, 1]
    for part in (driver < 3, driver >= 3):
        for held in (found.position, found.heading):
            assert held[part].mean() == pytest.approx(0.95, abs=4 * np.sqrt(0.95 * 0.05 / part.sum()))
    exact = np.pi * 5.991 * np.sqrt(0.4) * (1 + driver)
    assert np.median(found.area[:, 0] / exact) == pytest.approx(1.0, abs=0.2)


def test_regions_of_a_fold_know_nothing_of_its_errors():
    """Law: with the errors of one fold made 100 times as large, its own regions stay as they were; those of others grow."""
    windows, fold = made(300)
    population = np.zeros(len(fold), bool)
    before = regions.cross_conformal(windows, fold, population)
    windows.errors[fold == 2] *= 100
    after = regions.cross_conformal(windows, fold, population)
    np.testing.assert_array_equal(after.area[fold == 2], before.area[fold == 2])
    assert (after.area[fold != 2] > 2 * before.area[fold != 2]).all()


def log(voyage="random_01-Jan-2020_10_00_00", rows=100) -> Log:
    time = np.arange(rows) / 10
    table = {name: np.arange(rows, dtype=float) for name in regions.MEASURED}
    return Log(
        pd.DataFrame({"time_s": time, "rudder_order_deg": 0.0 * time, **table}),
        load_vessel("esso_osaka"),
        source="made",
        voyage=voyage,
    )


def test_halves_share_no_sample_and_lose_none():
    """By construction: every measured sample is in one half and not in the other; orders are in both."""
    whole = log()
    first, second = (regions.half(whole, which).table for which in (0, 1))
    for name in regions.MEASURED:
        assert (first[name].isna() != second[name].isna()).all()
    assert first["midship_north_m"].notna().to_numpy()[:20].tolist() == [True] * 10 + [False] * 10
    assert first["rudder_order_deg"].notna().all()


def test_parts_of_a_recording_stay_in_one_fold():
    """By construction: three parts of one voyage and four others in three folds, kinds spread evenly."""
    logs = [log("random_a", 50)] * 3 + [
        log(name, 40 + k) for k, name in enumerate(("random_b", "turn_c", "turn_d", "zigzag_e"))
    ]
    dealt = esso_osaka.folds(logs, 3)
    assert sorted(name for fold in dealt for name in fold) == ["random_a", "random_b", "turn_c", "turn_d", "zigzag_e"]
    assert max(sum(name.startswith("turn") for name in fold) for fold in dealt) == 1


@dataclass(frozen=True)
class Forced:
    """Windows as far as `seen_orders` reads them."""

    spec: object
    forcing: np.ndarray


def test_orders_that_training_hardly_had_are_unseen():
    """By construction: shaft speeds of -10 and 10 rev/s in training and one instant in 1000 at 20; 12 is then unseen."""
    shaft = np.where(np.arange(1000) % 2, 10.0, -10.0)
    shaft[0] = 20.0
    spec = type("Spec", (), {"forcings": ("rudder_angle", "shaft_speed")})
    seen = esso_osaka.seen_orders(Forced(spec, np.stack([np.linspace(-0.6, 0.6, 1000), shaft], -1)[None]))
    assert seen["shaft_speed"] == (-10.0, 10.0)
    told = [
        esso_osaka.unseen(Plan(Orders.held(rudder), Orders.held(n)), seen)
        for rudder, n in ((0.1, 10), (0.1, 12), (0.7, 0))
    ]
    assert told == [False, True, True]


def test_regions_of_a_quick_ship_grow_with_the_order_and_the_distance_run():
    """By hand: 3 and 4 m/s along and across make 5 m a second; an order of 0.1 rad from amidships, given at 10 s."""
    time = np.arange(0.0, 31.0, 10.0)
    flat = np.zeros((2, len(time)))
    path = Motion(time, flat, flat, flat, flat + 3.0, flat + 4.0, flat, flat)
    plans = [Plan(Orders(np.array([0.0, 10.0]), np.array([0.0, size]))) for size in (0.1, -0.2)]
    found = regions.driving(path, plans, np.zeros(2), np.array([0.02, -0.03]))
    assert found.shape == (2, 4, 6)
    np.testing.assert_allclose(np.sqrt(found[..., 4]), [[0, 5, 10, 15], [0, 10, 20, 30]], atol=1e-12)
    np.testing.assert_allclose(np.sqrt(found[..., 5]), [[0.02] * 4, [0.03] * 4])


def test_labels_that_jump_are_found():
    """By hand: circles of 3 m at 0.5 m/s, sway and all, at 1 s; one of three is set off by 8 cm from 12 s on, one by 2 cm."""
    time = np.arange(31.0)
    place = 3 * np.exp(1j * (time / 6 + np.arange(3)[:, None]))
    place = place + np.array([[0.0], [0.08j], [0.02]]) * (time >= 12)
    speed = 0.5j * np.exp(1j * (time / 6 + np.arange(3)[:, None]))
    heading = np.angle(speed) - 0.2  # sways
    over = speed * np.exp(-1j * heading)
    flat = np.zeros((3, len(time)))
    path = Motion(time, place.real, place.imag, heading, over.real, over.imag, flat, flat)
    found = regions.jumping(type("Evaluation", (), {"reference": path}))
    assert found.tolist() == [False, True, False]


def test_seeds_are_told_by_median_and_range():
    """By hand: three sets of seeds; of groups with too few windows for it, no p95."""

    def one(k: float) -> dict:
        values = {"median m": [k, 2 * k, 3 * k], "heading deg": [10 * k] * 3}
        held = {"windows": 30, "position": [k] * 3, "heading": [1 - k] * 3}
        few = {"windows": 3}
        return {
            "by_horizon": {g: {"net": values} for g in ("order", "steady", tables.WHOLE)},
            "coverage": {"all": held, "turn": few},
        }

    shown = tables.seeds_table([one(0.3), one(0.1), one(0.15)], "net")
    rows = list(zip(*(column.cells for column in shown.columns), strict=True))
    assert rows[0][:5] == (
        "order",
        "median m",
        "0.150 / 0.300 / 0.450",
        "0.100 / 0.200 / 0.300",
        "0.300 / 0.600 / 0.900",
    )
    assert [row[:2] for row in rows[1:]] == [
        ("order", "heading deg"),
        ("steady", "median m"),
        (tables.WHOLE, "median m"),
        (tables.WHOLE, "heading deg"),
        ("all", "position held"),
        ("all", "heading held"),
    ]
    assert rows[-1][2:5] == ("0.850 / 0.850 / 0.850", "0.700 / 0.700 / 0.700", "0.900 / 0.900 / 0.900")
