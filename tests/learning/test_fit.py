"""Training: bit-equal repeats, resumption, and a plant whose answer is known."""

import csv
import shutil
from dataclasses import replace

import numpy as np
import pytest
import torch

from aspnn.learning import fit
from aspnn.learning.network import RolloutGru, RolloutSizes, flat_range, path_of
from tests.learning.conftest import nomoto_windows

SETTINGS = fit.FitSettings(epochs=3, batch=32, learning_rate=8e-3, one_cycle=True, clip=1.0, seed=5)
LOSS = fit.path_loss(fit.Tolerance((0.5, 0.05), (0.01, 0.001), 0.1))


def fresh(windows, seed=5) -> RolloutGru:
    torch.manual_seed(seed)
    spec = windows.spec
    network = RolloutGru(RolloutSizes(len(spec.inputs), 1, (0, 1, 2), 35.0, -35.0, spec.period, latent=12))
    arrays = {name: torch.from_numpy(np.array(getattr(windows, name))) for name in ("history", "forcing", "target")}
    network.history.set(*flat_range(arrays["history"], 2.0))
    network.forcing.set(*flat_range(arrays["forcing"], 2.0))
    network.motion.set(*flat_range(network.to_motion(arrays["target"]), 2.0))
    return network


def trained(windows, folder, settings=SETTINGS, network=None) -> dict:
    network = network or fresh(windows, settings.seed)
    fit.fit(network, LOSS, windows, windows.select(np.arange(20)), settings, folder, quiet=True)
    return network.state_dict()


def equal(a, b) -> bool:
    return all(torch.equal(a[name], b[name]) for name in a)


def test_seeded_runs_repeat_bit_by_bit(windows, tmp_path):
    first, second = (trained(windows, tmp_path / name) for name in "ab")
    assert equal(first, second)
    assert not equal(first, trained(windows, tmp_path / "c", replace(SETTINGS, seed=6)))


def test_killed_run_goes_on_as_if_nothing_had_happened(windows, tmp_path, monkeypatch):
    """Oracle: the same run without the kill, bit by bit; the kill strikes inside the third epoch."""
    whole = trained(windows, tmp_path / "whole")
    calls = iter(range(1000))

    def killed(network, batch):
        if next(calls) == 2 * (-(-len(windows) // 32)) + 2 * 1 + 1:  # two epochs with their validation, then one step
            raise KeyError("killed")
        return LOSS(network, batch)

    with pytest.raises(KeyError, match="killed"):
        fit.fit(fresh(windows), killed, windows, windows.select(np.arange(20)), SETTINGS, tmp_path / "cut", quiet=True)
    with open(tmp_path / "cut" / "curves.csv") as file:
        assert [row["epoch"] for row in csv.DictReader(file)] == ["0", "1"]
    assert equal(whole, trained(windows, tmp_path / "cut"))
    with open(tmp_path / "cut" / "curves.csv") as file:
        assert [row["epoch"] for row in csv.DictReader(file)] == ["0", "1", "2"]
    shutil.rmtree(tmp_path)


def test_learns_a_ship_it_can_know(tmp_path):
    """Oracle: the Nomoto ship of the test voyages, unseen ones; heading errors at 60 s shrink at least tenfold."""
    windows = nomoto_windows(range(4))
    unseen = nomoto_windows(range(10, 12))
    network = fresh(windows)

    def error() -> float:
        with torch.inference_mode():
            found = network(*(torch.from_numpy(a) for a in (unseen.history, unseen.forcing, unseen.wind)))
            path = path_of(found, 2.0, 35.0, -35.0).numpy()
        return float(np.median(np.abs(path[:, -1, 2] - unseen.path[:, -1, 2])))

    before = error()
    trained(windows, tmp_path, replace(SETTINGS, epochs=25), network)
    assert error() < before / 10


def test_run_folder_has_the_logs_it_promises(windows, tmp_path):
    trained(windows, tmp_path)
    assert (tmp_path / "csv" / "metrics.csv").stat().st_size > 0
    assert list((tmp_path / "tensorboard").glob("events.out.tfevents.*"))
    assert (tmp_path / "resume" / "last.ckpt").exists()
