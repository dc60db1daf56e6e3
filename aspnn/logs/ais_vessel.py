"""The vessel of an AIS log: what the ship announces of itself, what is assumed, and the noise of its reports.

Assumed, where nobody tells it: the noise of fixes (`accurate`: 10 m or better, in 95 % of cases 2.45 deviations per axis, of which
a filter feels the short-term half), of headings in whole degrees and of rates of turn in their coarse steps; the rudder, 35 degrees
from side to side in the 28 s of SOLAS II-1/29; a service speed of Froude number 0.2; proportions of a ship. A vessel file is better.
"""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from aspnn.instruments import Calibration, Noise, scaled_noise
from aspnn.logs.ais_messages import COARSE, Static
from aspnn.schema import InputError
from aspnn.vessel import Vessel, from_dict

ANTENNA = "gnss"
ACCURATE, PLAIN = 2.0, 4.0  # m, deviation of a fix per axis; with the flag of 10 m or better, and without
TENTH = 185.2 / math.sqrt(12)  # m: rounding to a tenth of a minute, of long-range reports
HEADING, YAW_RATE = (
    math.radians(0.6),
    math.radians(0.05),
)  # gyro of 0.5 degrees in whole degrees; steps of 0.03 at 20 deg/min
LENGTHS = {True: 100.0, False: 12.0}  # m; class A, class B where nothing is announced
SLENDER, FULL = 6.0, 2.5  # length to beam, beam to draught
FROUDE, GRAVITY = 0.2, 9.81
ALIKE = 0.1  # of the length: by so much may a vessel file differ from what the ship announces


def announced(mmsi: int, statics: Sequence[Static], kinds: set[int], accurate: float) -> tuple[Vessel, dict[str, Any]]:
    """The vessel that `statics` announce, with the antenna at its station, and notes on where it comes from.

    `kinds` are the types of its reports, `accurate` the share flagged as 10 m or better. The antenna is A from the bow, B from the
    stern, C from the port and D from the starboard side: length A + B, beam C + D, station ((B - A) / 2, (C - D) / 2). A = C = 0
    tells the dimensions and no station: amidships then. Of several announcements the most frequent counts.
    """
    sizes = Counter(s.size for s in statics if s.size is not None and s.size[0] + s.size[1] > 1)
    names, depths = Counter(s.name for s in statics if s.name), Counter(s.draught for s in statics if s.draught)
    notes: dict[str, Any] = {}
    told, assumed = "announced by AIS", "assumed"
    class_a = bool(kinds & {1, 2, 3, COARSE})
    if sizes:
        a, b, c, d = sizes.most_common(1)[0][0]
        length, beam, origin = float(a + b), float(c + d), told
        placed = not (a == 0 and c == 0)
        x, y = ((b - a) / 2 if placed else 0.0), ((c - d) / 2 if placed else 0.0)
        notes["size"] = (
            f"{a} m to bow, {b} to stern, {c} to port, {d} to starboard{'' if placed else ': no station, amidships'}"
        )
        if len(sizes) > 1:
            notes["other_sizes"] = "; ".join(" ".join(map(str, size)) for size, _ in sizes.most_common()[1:4])
    else:
        length, beam, origin, x, y = LENGTHS[class_a], 0.0, assumed, 0.0, 0.0
        notes["size"] = f"not announced: {length:g} m assumed, antenna amidships; name a vessel file"
    if names:
        notes["ship"] = names.most_common(1)[0][0]
    wide = beam or length / SLENDER
    deep = depths.most_common(1)[0][0] if depths else wide / FULL
    data = {
        "name": f"mmsi{mmsi:09d}",
        "title": f"{notes.get('ship', 'unnamed')} (MMSI {mmsi:09d})",
        "dimensions": {"length_overall_m": length, "beam_m": wide, "draught_m": deep},
        "stations_m": {ANTENNA: [x, y]},
        "rudder": {"max_deg": 35.0, "rate_deg_s": 2.32},
        "service": {"speed_m_s": round(FROUDE * math.sqrt(GRAVITY * length), 3)},
        "sources": {
            "dimensions.length_overall_m": origin,
            "dimensions.beam_m": told if beam else assumed,
            "dimensions.draught_m": told if depths else assumed,
            f"stations_m.{ANTENNA}": origin,
            "rudder": "assumed, SOLAS II-1/29",
            "service": f"assumed, Froude number {FROUDE}",
            "sensors": "assumed for AIS",
            "process": "that of cargo90, scaled by length",
        },
    }
    vessel = from_dict(data, f"MMSI {mmsi}")
    return replace(vessel, noise=_noise(scaled_noise(length), kinds, accurate)), notes


def fitted(vessel: Vessel, hull: Vessel, notes: dict[str, Any], mmsi: int, where: str) -> tuple[Vessel, dict[str, Any]]:
    """`vessel` in place of the announced `hull`: with its antenna, unless it has one of its own, and the noise of AIS reports.

    Raises InputError where it has not the length that the ship announces.
    """
    known = hull.sources["dimensions.length_overall_m"] != "assumed"
    if known and abs(vessel.length - hull.length) > ALIKE * hull.length:
        raise InputError(
            f"{where}: MMSI {mmsi} announces {hull.length:g} m, {vessel.label} is {vessel.length:g} m long; "
            "choose the ship by its MMSI, or leave the vessel out"
        )
    stations = {} if ANTENNA in vessel.stations else {ANTENNA: hull.stations[ANTENNA]}
    sensors = {
        name: max(getattr(vessel.noise, name), getattr(hull.noise, name))
        for name in ("position", "heading", "yaw_rate")
    }
    ship = replace(
        vessel.with_stations(**stations),
        noise=replace(vessel.noise, **sensors),
        calibration=Calibration(heading_offset=vessel.calibration.heading_offset),
    )
    return ship, notes | {"vessel": f"{vessel.label}, with the noise of AIS reports"}


def _noise(noise: Noise, kinds: set[int], accurate: float) -> Noise:
    position = ACCURATE if accurate > 0.5 else PLAIN
    if kinds == {COARSE}:
        position = math.hypot(position, TENTH)
    return replace(noise, position=position, heading=HEADING, yaw_rate=YAW_RATE)
