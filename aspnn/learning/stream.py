"""Windows beyond memory: written voyage by voyage, joined into one file, and read from it through a memory map.

The mapped file is the windowed dataset of `write_windows`; its arrays are ordinary ones to all who use them, but only what
is touched comes into memory, and the system may drop it again. Training on them gives the same weights bit by bit.
"""

import json
import math
import shutil
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np
import torch

from aspnn.learning.windows import ARRAYS, Windows, WindowSpec, read_windows, write_windows
from aspnn.records import atomic
from aspnn.schema import InputError

TYPES = {np.dtype("<f4"): "F32", np.dtype("<f8"): "F64", np.dtype("<i8"): "I64"}
ROWS = 1024  # windows handled at a time


class Store:
    """Windows on their way to a file: each part in a file of its own in `folder`, one part in memory at a time."""

    def __init__(self, folder: Path):
        self.folder = folder
        shutil.rmtree(folder, ignore_errors=True)
        self.parts: list[Path] = []

    def add(self, windows: Windows) -> Path:
        """Put windows away; the file that holds them."""
        self.parts.append(self.folder / f"{len(self.parts):06d}.safetensors")
        write_windows(windows, self.parts[-1])
        return self.parts[-1]

    def clear(self) -> None:
        """Delete the parts."""
        shutil.rmtree(self.folder)


def join(parts: Sequence[Path], path: Path, limit: int | None = None) -> Windows:
    """Windows of several files in one, mapped: `concatenate`, then the first `limit`, with one part in memory at a time.

    Raises InputError when there are no parts.
    """
    if not parts:
        raise InputError("no voyage gave a window")
    names: list[str] = []
    kept: list[int] = []
    for part in parts:
        windows = read_windows(part)
        names += [name for name in windows.voyages if name not in names]
        kept.append(len(windows) if limit is None else min(len(windows), limit - sum(kept)))
    first, count = read_windows(parts[0]), sum(kept)
    arrays = {name: getattr(first, name) for name in ARRAYS}
    arrays = dict(sorted(arrays.items(), key=lambda item: -item[1].itemsize))  # so that each is aligned
    header: dict = {
        "__metadata__": {
            "spec": json.dumps(asdict(first.spec)),
            "voyages": json.dumps(tuple(names)),
            "format": "1",
        }
    }
    offset = 0
    for name, array in arrays.items():
        shape = (count, *array.shape[1:])
        end = offset + math.prod(shape) * array.itemsize
        header[name] = {"dtype": TYPES[array.dtype], "shape": shape, "data_offsets": (offset, end)}
        offset = end
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 8)
    with atomic(path) as temporary:
        with open(temporary, "wb") as file:
            file.write(len(text).to_bytes(8, "little") + text)
            file.truncate(8 + len(text) + offset)
        rows = _mapped(temporary, "r+")
        done = 0
        for part, number in zip(parts, kept, strict=True):
            windows = read_windows(part)
            for name in ARRAYS:
                values = getattr(windows, name)
                if name == "voyage":
                    values = np.array([names.index(v) for v in windows.voyages], np.int64)[values]
                rows[name][done : done + number] = values[:number]
            done += number
    return map_windows(path)


def _mapped(path: str | Path, mode: str) -> dict[str, np.ndarray]:
    """The arrays of a safetensors file through one memory map."""
    with open(path, "rb") as file:
        size = int.from_bytes(file.read(8), "little")
        header = json.loads(file.read(size))
    data = np.memmap(path, np.uint8, mode, 8 + size)  # type: ignore[call-overload]
    back = {name: dtype for dtype, name in TYPES.items()}
    found = {}
    for name in ARRAYS:
        begin, end = header[name]["data_offsets"]
        found[name] = data[begin:end].view(back[header[name]["dtype"]]).reshape(header[name]["shape"])
    return found


def mapped_motion(change: Callable[[torch.Tensor], torch.Tensor], values: np.ndarray) -> torch.Tensor:
    """`change` of float32 values, window by window; where they are mapped from a file, so is the result, which has no name."""
    if not isinstance(values, np.memmap):
        return change(torch.from_numpy(values))
    with tempfile.TemporaryFile(dir=Path(str(values.filename)).parent) as file:
        file.truncate(values.nbytes)
        result = np.memmap(file, values.dtype, "r+", shape=values.shape)
    for k in range(0, len(values), ROWS):
        result[k : k + ROWS] = change(torch.from_numpy(np.array(values[k : k + ROWS]))).numpy()
    return torch.from_numpy(result)


def map_windows(path: str | Path) -> Windows:
    """The windows of a file of `join` or `write_windows`, through a memory map that cannot be written to."""
    with open(path, "rb") as file:
        metadata = json.loads(file.read(int.from_bytes(file.read(8), "little")))["__metadata__"]
    spec = WindowSpec.from_dict(json.loads(metadata["spec"]))
    return Windows(spec, voyages=tuple(json.loads(metadata["voyages"])), **_mapped(path, "r"))
