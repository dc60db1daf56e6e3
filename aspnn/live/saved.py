"""What the filters leave for the next row, as plain data and arrays, for a file that another process goes on from.

No pickle: a saved state is numbers and names alone, so that a file from elsewhere can be wrong, but can do nothing.
"""

from dataclasses import asdict
from typing import Any

import numpy as np

from aspnn.estimation.cascade import Memory
from aspnn.estimation.measurements import Opening, Past
from aspnn.estimation.problem import Carry
from aspnn.estimation.rows import Rows
from aspnn.estimation.states import Held

CARRIED = ("x", "P", "last", "rejections", "given_in")


def packed(begin: Opening, memory: Memory) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """An opening and a memory as JSON data (which keeps every bit of a number) and arrays by name."""
    past = memory.past
    assert isinstance(past.rows, Rows) and begin.origin is not None  # a filter row by row, that has begun
    data: dict[str, Any] = {
        "begin": {"first": begin.first, "twins": sorted(begin.twins)},
        "past": {"shown": past.shown, "second": past.second, "gamma": past.gamma},
        "held": asdict(memory.held),
        "filters": [carry.time for carry in memory.filters],
    }
    arrays = {"origin": begin.origin, "place": begin.place, "rows": past.rows.values}
    arrays |= {"past_place": past.place, "settled": past.settled}
    for i, carry in enumerate(memory.filters):
        arrays |= {f"{name}_{i}": getattr(carry, name) for name in CARRIED}
    return data, arrays


def unpacked(data: dict[str, Any], arrays: dict[str, np.ndarray], columns: tuple[str, ...]) -> tuple[Opening, Memory]:
    """The opening and the memory of `packed`; `columns` are those of the rows."""
    twins = frozenset((a, b) for a, b in data["begin"]["twins"])
    begin = Opening(data["begin"]["first"], arrays["origin"], arrays["place"], twins)
    past, held = data["past"], data["held"]
    shown = {name: tuple(digits) for name, digits in past["shown"].items()}
    rows = Rows(columns, arrays["rows"])
    if len(rows.values) != len(columns):
        raise ValueError(f"{len(rows.values)} columns of rows, expected {len(columns)}")
    heading, motion = (
        Carry(time, *(arrays[f"{name}_{i}"] for name in CARRIED)) for i, time in enumerate(data["filters"])
    )
    servo = None if held["servo"] is None else tuple(held["servo"])
    return begin, Memory(
        Past(rows, shown, arrays["past_place"], arrays["settled"], past["second"], past["gamma"]),
        (heading, motion),
        Held(**{**held, "servo": servo}),
    )
