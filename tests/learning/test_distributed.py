"""Training in several processes: what one process finds, to the rounding of a sum; one writer; resumption."""

import csv
import multiprocessing
import os
from dataclasses import replace

import numpy as np
import pytest
import torch

from aspnn.learning import fit
from aspnn.learning.network import ThesisGru, ThesisSizes, flat_range
from aspnn.schema import InputError
from tests.learning.test_fit import LOSS, SETTINGS, equal, fresh

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="processes are forked")
CLOSE = {"rtol": 1e-4, "atol": 1e-5}  # float32 sums in another order, over some fifteen steps
ONE = replace(SETTINGS, batch=39)  # 157 windows: the last batch holds a single one, less than there are processes
TWO = replace(ONE, devices=2)


def run(windows, folder, settings, network=None, loss=LOSS):
    network = network or fresh(windows)
    rows = fit.fit(network, loss, windows, windows.select(np.arange(21)), settings, folder, quiet=True)
    return network.state_dict(), rows


def assert_close(a, b) -> None:
    for name in a:
        torch.testing.assert_close(a[name], b[name], **CLOSE)


@pytest.fixture(scope="module")
def one(windows, tmp_path_factory):
    assert len(windows) % ONE.batch == 1
    return run(windows, tmp_path_factory.mktemp("one"), ONE)


@pytest.fixture(scope="module")
def two(windows, tmp_path_factory):
    folder = tmp_path_factory.mktemp("two")
    return *run(windows, folder, TWO), folder


def test_two_processes_find_what_one_finds(one, two):
    """Oracle: one process; weights and both losses of every epoch, with a last batch that one process has no part in."""
    assert_close(one[0], two[0])
    for single, double in zip(one[1], two[1], strict=True):
        assert double == pytest.approx(single, rel=1e-4)


def test_only_one_process_writes(two):
    """One row per epoch in the curves and in Lightning's table, one event file."""
    folder = two[2]
    with open(folder / "curves.csv") as file:
        assert [float(row["epoch"]) for row in csv.DictReader(file)] == [0, 1, 2]
    assert len(list((folder / "tensorboard").glob("events*"))) == 1
    assert len(list(folder.glob("csv/**/metrics.csv"))) == 1


def test_a_killed_run_goes_on_in_two_processes(windows, two, tmp_path):
    """Oracle: the run of two processes without the kill, bit by bit; the first epochs' states come from its checkpoint."""

    def hear(title, row):
        if row["epoch"] == 1:
            raise KeyError("killed")

    with pytest.raises(Exception, match="killed"):
        network = fresh(windows)
        fit.fit(network, LOSS, windows, windows.select(np.arange(21)), TWO, tmp_path, quiet=True, hear=hear)
    kept = torch.load(tmp_path / "resume" / "last.ckpt", weights_only=True)
    assert kept["epoch"] == 0  # the first epoch is whole
    assert equal(run(windows, tmp_path, TWO)[0], two[0])


def test_thesis_networks_train_in_two_processes(windows, tmp_path):
    """Oracle: one process. Each of the three networks is trained alone, so most weights have no gradient."""

    def made():
        torch.manual_seed(3)
        network = ThesisGru(ThesisSizes(4, windows.spec.horizon_steps, latent=4, dense=(6, 5)))
        network.history.set(*flat_range(torch.from_numpy(windows.history)))
        network.target.set(*flat_range(torch.from_numpy(windows.target)))
        return network

    short = replace(ONE, epochs=1)
    found = [
        run(windows, tmp_path / str(devices), replace(short, devices=devices), made(), fit.thesis_loss(1))[0]
        for devices in (1, 2)
    ]
    assert_close(*found)


def _node(rank, windows, folder, queue) -> None:
    os.environ["NODE_RANK"] = str(rank)
    weights, _ = run(windows, folder, replace(ONE, nodes=2))
    queue.put((rank, {name: value.numpy() for name, value in weights.items()}))


def test_two_nodes_of_one_process_find_what_one_finds(windows, one, tmp_path, monkeypatch):
    """Oracle: one process. Two processes of this machine stand for two nodes that share the run folder."""
    monkeypatch.setenv("MASTER_ADDR", "127.0.0.1")
    monkeypatch.setenv("MASTER_PORT", str(_free_port()))
    context = multiprocessing.get_context("fork")
    queue = context.SimpleQueue()
    nodes = [context.Process(target=_node, args=(rank, windows, tmp_path, queue)) for rank in (0, 1)]
    for node in nodes:
        node.start()
    for node in nodes:
        node.join(60)
        assert node.exitcode == 0
    for _, weights in (queue.get(), queue.get()):
        assert_close(one[0], {name: torch.from_numpy(value) for name, value in weights.items()})


def _free_port() -> int:
    import socket

    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def test_nodes_without_an_address_are_one_line(windows, tmp_path, monkeypatch):
    monkeypatch.delenv("MASTER_ADDR", raising=False)
    with pytest.raises(InputError, match="--num-nodes 2: set MASTER_ADDR, MASTER_PORT and NODE_RANK"):
        run(windows, tmp_path, replace(ONE, nodes=2))
