"""The published path algorithms, as printed and corrected, beside the exact rigid-body step: where they end.

    python training/reproduce/pivot_paths.py [--json FILE]

Steady turns to starboard: the 90 m ship of errata E40 and E41, whose surge and pivot point are not stated there (5 m/s and
22 m ahead of midship give its figures), and a boat of 8 m like that of Paper VI.
"""

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np

from aspnn.cli import guarded, say
from aspnn.motion import Path as Track
from aspnn.motion import integrate, paper_v_path, pivot_path, region_map_path
from aspnn.motion.algorithms import midpoint_path, paper_v_corrected, paper_v_printed, paper_vi_printed, thesis_printed
from aspnn.records import atomic

CASES = (  # name, surge [m/s], pivot point [m], yaw rate [deg/s], horizon [s], x of the bow station [m], length [m]
    ("90 m ship, 1 deg/s, 90 s", 5.0, 22.0, 1.0, 90.0, 35.0, 90.0),
    ("8 m boat, 25 deg/s, 10 s", 5.0, 2.37, 25.0, 10.0, 3.2, 8.0),
)
STEPS = (0.1, 0.13, 1.0, 5.0)  # s; of 0.13 as many as come nearest to the horizon


def compared() -> list[dict[str, Any]]:
    """Where each algorithm ends beside the exact step [m, deg], in steady turns to starboard (E40, E41)."""
    found = []
    for name, u, pivot, rate, span, station, length in CASES:
        for dt in STEPS:
            steps = round(span / dt)
            r = np.full(steps, np.radians(rate))
            motion = np.full(steps, u), -pivot * r, r
            stations = motion[0], *(motion[1] + r * x for x in (station, -station)), dt, station, -station
            start, end = (0.0, 0.0, 0.0), integrate((0, 0, 0), np.stack(motion, -1), dt)
            paths: dict[str, Track] = {
                "thesis 4.1 as printed": thesis_printed(start, *motion, dt),
                "Paper VI as printed": paper_vi_printed(start, *motion, dt),
                "thesis 4.1 / VI corrected": pivot_path(start, *motion, dt),
                "the same, sign of L flipped": pivot_path(start, motion[0], -motion[1], r, dt),
                "Paper V as printed": paper_v_printed(start, *stations),
                "Paper V, signed distance": paper_v_path(start, *stations),
                "Paper V corrected": paper_v_corrected(start, *stations),
                "Paper V's regions, exact step": region_map_path(start, *stations, length),
                "midpoint heading": midpoint_path(start, *motion, dt),
            }
            for way, path in paths.items():
                apart = float(np.hypot(path.north[-1] - end.north[-1], path.east[-1] - end.east[-1]))
                turned = float(np.degrees(path.heading[-1] - end.heading[-1]))
                found.append({"case": name, "dt_s": dt, "algorithm": way, "position_m": apart, "heading_deg": turned})
    return found


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--json", type=Path)
    given = options.parse_args()
    found = compared()
    for name, *_ in CASES:
        say(False, f"\n{name}: distance from the exact step's end, m (heading error, deg)")
        say(False, "| algorithm | " + " | ".join(f"dt {dt:g} s" for dt in STEPS) + " |\n|---|" + "---|" * len(STEPS))
        here = [row for row in found if row["case"] == name]
        for way in dict.fromkeys(row["algorithm"] for row in here):
            cells = [f"{row['position_m']:.3g} ({row['heading_deg']:+.3g})" for row in here if row["algorithm"] == way]
            say(False, f"| {way} | {' | '.join(cells)} |")
    if given.json:
        with atomic(given.json) as temporary:
            temporary.write_text(json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    guarded(main)
