"""Windows beyond memory: the same windows, the same weights, and no more memory than a part of them takes."""

import subprocess
import sys

import numpy as np
import pytest
import torch

from aspnn.learning import stream
from aspnn.learning.windows import concatenate, read_windows
from aspnn.schema import InputError
from tests.learning.conftest import assert_windows_equal, nomoto_windows
from tests.learning.test_fit import equal, trained


@pytest.fixture(scope="module")
def parts():
    return [nomoto_windows((0,)), nomoto_windows((1,)), nomoto_windows((0,))]


@pytest.mark.parametrize("limit", [None, 90])
def test_joined_files_are_the_windows(parts, tmp_path, limit):
    """Oracle: `concatenate` in memory; the file reads back by `read_windows` as well as through the map."""
    store = stream.Store(tmp_path / "parts")
    mapped = stream.join([store.add(part) for part in parts], tmp_path / "all.safetensors", limit)
    store.clear()
    memory = concatenate(parts)
    memory = memory if limit is None else memory.select(np.arange(limit))
    assert_windows_equal(mapped, memory)
    assert_windows_equal(read_windows(tmp_path / "all.safetensors"), memory)
    assert not (tmp_path / "parts").exists()
    with pytest.raises(ValueError, match="read-only"):
        mapped.history[0] = 0


def test_nothing_to_join_is_one_line(tmp_path):
    with pytest.raises(InputError, match="no voyage gave a window"):
        stream.join([], tmp_path / "none.safetensors")


def test_weights_are_those_of_windows_in_memory(parts, tmp_path):
    """Oracle: training in memory with the same seed, bit by bit."""
    store = stream.Store(tmp_path / "parts")
    mapped = stream.join([store.add(part) for part in parts], tmp_path / "all.safetensors")
    assert equal(trained(mapped, tmp_path / "mapped"), trained(concatenate(parts), tmp_path / "memory"))


def test_motion_of_mapped_values_is_that_of_values(tmp_path, monkeypatch):
    """Oracle: the function on the whole array, which a mapped one must not be in memory for."""
    monkeypatch.setattr(stream, "ROWS", 7)
    values = np.random.default_rng(1).normal(size=(50, 4, 3)).astype(np.float32)
    np.save(tmp_path / "values.npy", values)
    found = stream.mapped_motion(torch.exp, np.load(tmp_path / "values.npy", mmap_mode="r"))
    assert torch.equal(found, torch.exp(torch.from_numpy(values)))


MEMORY = """
import sys
from pathlib import Path

import numpy as np
import torch

from aspnn.learning import fit, stream
from aspnn.learning.network import RolloutGru, RolloutSizes, flat_range
from aspnn.learning.windows import Windows, WindowSpec

folder, count, steps = Path(sys.argv[1]), 2500, 200
spec = WindowSpec(2.0 * steps, 4.0, 2.0, ("surge", "sway_bow", "sway_stern", "rudder_angle"), ("rudder_angle",))


def part(seed):
    draw = np.random.default_rng(seed).normal
    shapes = {"history": (steps, 4), "forcing": (3, 1), "target": (3, 3), "path": (3, 3), "wind": (2,)}
    arrays = {name: draw(size=(count, *shape)).astype(np.float32) for name, shape in shapes.items()}
    return Windows(spec, start=np.arange(count, dtype=float), voyage=np.zeros(count, int), voyages=(str(seed),), **arrays)


def anonymous():
    line = next(line for line in open("/proc/self/status") if line.startswith("RssAnon"))
    return int(line.split()[1]) * 1024


def train(windows, name):
    network = RolloutGru(RolloutSizes(4, 1, (0, 1, 2), 35.0, -35.0, 2.0, latent=4))
    network.history.set(*flat_range(fit.tensor(windows.history), 2.0))
    network.motion.set(*flat_range(stream.mapped_motion(network.to_motion, windows.target), 2.0))
    seen = []

    def loss_and_memory(network, batch):
        seen.append(anonymous())
        return network.out.bias.square().sum() + batch[0].mean()  # all that is read, and next to no arithmetic

    fit.fit(network, loss_and_memory, windows, None, fit.FitSettings(1, batch=200), folder / name, quiet=True)
    return max(seen)


train(part(0).select(np.arange(128)), "warm")
store = stream.Store(folder / "parts")
paths = [store.add(part(seed)) for seed in range(12)]
before = anonymous()
windows = stream.join(paths, folder / "all.safetensors")
print(windows.history.nbytes, train(windows, "mapped") - before)
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")
def test_training_takes_less_memory_than_its_windows(tmp_path):
    """Linux's own count of memory that no file backs (RssAnon): twelve parts of 8 MB take less than three of them."""
    done = subprocess.run([sys.executable, "-c", MEMORY, str(tmp_path)], capture_output=True, text=True, check=True)
    size, taken = map(int, done.stdout.split())
    assert size == 12 * 2500 * 200 * 4 * 4
    assert taken < size / 4
