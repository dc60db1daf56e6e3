"""Targets as the situation message has them (`page/SITUATION.md`): degrees, true bearings, plain numbers, null for what is not known."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from aspnn.frames import Zone
from aspnn.live.ahead import ANY, Kind
from aspnn.live.encounter import Danger
from aspnn.live.situation import ROUGH, bearing, degrees_of, plain
from aspnn.motion import Path

EVERY = 10.0  # s between the points of a target's path in the message
FLAT = 0.5  # m: an arc that is as near to its chord is two points
MARKS = 30.0  # s between her outlines
OUTLINED = 6  # dangerous targets whose outlines ahead are in the message; of all of fifty they would be half of it


def target_entries(dangers: Sequence[Danger], paths: Path, now: float, zone: Zone) -> list[dict[str, Any]]:
    """The `targets` of the message, in the order of `dangers`, of which `paths` (targets, steps) are the predicted paths from `now`."""
    if not dangers:
        return []
    targets = [danger.target for danger in dangers]
    rows = np.array([danger.index for danger in dangers])
    lines = _lines(dangers, paths, rows, zone)
    rings = _outlines(dangers, paths, zone)
    # All of one kind in one call: a projection, and rounding, cost far more by the call than by the number.
    nearest = np.array([[danger.cpa_own, danger.cpa_target] for danger in dangers])
    near_lat, near_lon = degrees_of(zone, nearest[..., 0], nearest[..., 1])
    ends = np.round(np.stack([near_lon, near_lat], axis=-1), ROUGH).tolist()
    gamma = np.array([target.convergence for target in targets])
    angles = np.array([[t.heading_told, t.course, d.bearing] for t, d in zip(targets, dangers, strict=True)]).T + gamma
    heading, course, seen = (bearing(angle) for angle in angles)
    numbers = {
        "sog": plain([t.speed for t in targets], 2),
        "rot": plain(np.degrees([t.rate_told for t in targets]) * 60, 2),
        "age": plain(now - np.array([t.time for t in targets]), 1),
        **{name: plain([getattr(d, name) for d in dangers], 1) for name in ("range", "cpa", "tcpa", "dcpa", "dtcpa")},
        "probability": plain([d.probability for d in dangers], 4),
    }
    found = []
    for k, (danger, target) in enumerate(zip(dangers, targets, strict=True)):
        own = {name: values[k] for name, values in numbers.items()}
        hulls = rings.get(k, [])
        found.append(
            {
                "id": target.id,
                "name": target.name or None,
                "kind": target.kind.value,
                "lat": lines[k]["lat"][0],
                "lon": lines[k]["lon"][0],
                "heading": heading[k],
                "cog": course[k],
                "sog": own["sog"],
                "rot": own["rot"],
                "age": own["age"],
                "outline": hulls[0] if hulls else None,
                "path": lines[k],
                "outlines": [{"time": MARKS * n, "ring": ring} for n, ring in enumerate(hulls[1:], start=1)],
                "range": own["range"],
                "bearing": seen[k],
                "cpa": own["cpa"],
                "tcpa": own["tcpa"],
                "cpa_own": ends[k][0],
                "cpa_target": ends[k][1],
                "probability": own["probability"],
                "dcpa": own["dcpa"],
                "dtcpa": own["dtcpa"],
                "dangerous": danger.dangerous,
            }
        )
    return found


def _lines(dangers: Sequence[Danger], paths: Path, rows: np.ndarray, zone: Zone) -> list[dict[str, Any]]:
    """The paths: every EVERY seconds, the ends alone where an AIS target (steady by her prediction) runs straight."""
    horizon = float(paths.time[-1])
    line = paths.at(np.append(np.arange(0.0, horizon - 1e-6, EVERY), horizon))
    lat, lon = degrees_of(zone, line.north[rows], line.east[rows])
    lat, lon, time = (np.round(x, digits).tolist() for x, digits in ((lat, ROUGH), (lon, ROUGH), (line.time, 2)))
    found = []
    for k, danger in enumerate(dangers):
        target = danger.target
        bulge = target.speed * abs(target.yaw_rate) * horizon**2 / 8
        step = len(time) - 1 if target.kind is Kind.ais and bulge < FLAT else 1
        found.append({"time": time[::step], "lat": lat[k][::step], "lon": lon[k][::step]})
    return found


def _outlines(dangers: Sequence[Danger], paths: Path, zone: Zone) -> dict[int, list[Any]]:
    """Rings of the hulls whose size and heading are known, by number: now, and of the first OUTLINED dangerous ones at each of MARKS."""
    marks = paths.at(np.arange(0.0, float(paths.time[-1]) + 1e-9, MARKS))
    place = marks.north + 1j * marks.east
    corners, count, owner, ahead = [], [], [], 0
    for k, danger in enumerate(dangers):
        target = danger.target
        if not target.sized or target.heading_sd >= ANY:
            continue
        ahead += danger.dangerous
        steps = len(marks.time) if danger.dangerous and ahead <= OUTLINED else 1
        turn = np.exp(1j * marks.heading[danger.index, :steps])[:, None]
        posed = place[danger.index, :steps, None] + turn * (target.drawn @ np.array([1, 1j]))
        corners.append(posed.ravel())
        count.append(posed.shape[1])
        owner.append((k, steps))
    if not owner:
        return {}
    points = np.concatenate(corners)
    lat, lon = degrees_of(zone, points.real, points.imag)
    ring = np.round(np.column_stack([lon, lat]), ROUGH)
    found, first = {}, 0
    for (k, steps), size in zip(owner, count, strict=True):
        found[k] = ring[first : first + steps * size].reshape(steps, size, 2).tolist()
        first += steps * size
    return found
