"""What AIS alone tells of a ship: simulated voyages sent as class A reports, read back, filtered, and held against the truth.

    python training/reproduce/ais.py [--voyages N] [--json FILE]

cargo90 under random rudder orders in a current of up to 1 m/s, fixes of 1 m of an antenna 35 m abaft midship; reports by the intervals of
ITU-R M.1371 (10 s, 3 1/3 s in turns), places in 1/10000 minute, heading in whole degrees, rate of turn in its codes, course and
speed over ground of 0.05 m/s in tenths, at once and 2 s late. All ships are in one file. Every method is run on from its last report
to each full second: the errors are those that a bridge sees between reports. Half a minute on one core.
"""

import argparse
import json
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from aspnn.angles import difference
from aspnn.estimation import filter_log
from aspnn.estimation.course import filter_course
from aspnn.estimation.over_ground import filter_over_ground
from aspnn.frames import convergence, station_velocity, to_geodetic, to_grid, to_north_east
from aspnn.logs.ais import import_ais
from aspnn.logs.ais_write import to_ais
from aspnn.records import Log, States
from aspnn.simulation.scenario import Scenario, simulate_scenario

SCENARIO: dict[str, Any] = {
    "name": "ais",
    "vessel": "cargo90",
    "duration_s": 1500,
    "seed": 70207,
    "start": {"speed_kn": 11.5, "latitude_deg": 69.65, "longitude_deg": 18.5, "zone": "33N", "heading_deg": "random"},
    "manoeuvre": {"kind": "random-orders", "rudder_deg": 35, "step_deg": 5, "hold_s": [60, 240]},
    "environment": {"current_kn": [0, 1.944], "current_towards_deg": "random"},
    "sensors": {"antennas": ["stern"], "position_hz": 1, "heading_hz": 1, "yaw_rate_hz": 1, "course_hz": 1},
}
SETTLED, TURNING = 120.0, np.radians(0.3)  # s, rad/s
LATE = 0.0, 2.0  # s: receivers smooth course and speed over ground; a yacht's compass told them 2.5 s late
MMSI = 257000000


def voyages(count: int, late: float = 0.0) -> tuple[list[Log], list[pd.DataFrame]]:
    """Logs as AIS tells them, course and speed over ground `late` [s], and the truth of each on its log's grid."""
    sensors = SCENARIO["sensors"] | {"course_delay_s": late}
    made = list(simulate_scenario(Scenario.model_validate(SCENARIO | {"voyages": count, "sensors": sensors})))
    lines = [line for k, (log, _) in enumerate(made) for line in to_ais(log, MMSI + k)]
    lines.sort(key=lambda line: int(line.split("c:")[1][:13]))  # as one station hears them
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "harbour.ais"
        file.write_text("".join(lines))
        logs = import_ais([file])
    truths = []
    for log, (sent, truth) in zip(logs, made, strict=True):
        latitude, longitude = to_geodetic(truth["north_m"], truth["east_m"], sent.zone)
        north, east = to_grid(latitude, longitude, log.zone)
        turned = convergence(latitude, longitude, sent.zone) - convergence(latitude, longitude, log.zone)
        whole = truth.assign(north_m=north, east_m=east, heading_rad=truth["heading_rad"] + turned)
        truths.append(whole[np.isclose(whole["time_s"] % 1, 0)].reset_index(drop=True))
    return logs, truths


def reported(log: Log, arc: bool) -> np.ndarray:
    """What the last report alone tells of the antenna (n, 6): north, east, speed, course, heading and, with `arc`, rate of turn."""
    table = log.table
    latitude, longitude = (np.radians(table[f"gnss_{axis}_deg"].to_numpy()) for axis in ("latitude", "longitude"))
    gamma = convergence(latitude, longitude, log.zone)
    heading, course = (np.radians(table[f"{c}_deg"].to_numpy()) - gamma for c in ("heading", "course_over_ground"))
    rate = np.radians(table["yaw_rate_deg_s"].to_numpy()) * arc
    place = to_grid(latitude, longitude, log.zone)
    return np.column_stack([*place, table["speed_over_ground_m_s"], course, heading, rate])


def filtered(states: States) -> np.ndarray:
    """The antenna by the states of a filter (n, 6), as `reported`."""
    x, y = states.vessel.stations["gnss"]
    heading, rate = states["heading_rad"], states["yaw_rate_rad_s"]
    u, v = station_velocity(states["surge_m_s"], states["sway_m_s"], rate, (x, y))
    north, east = to_north_east(x, y, heading)
    place = states["north_m"] + north, states["east_m"] + east
    return np.column_stack([*place, np.hypot(u, v), heading + np.arctan2(v, u), heading, rate])


def without(log: Log, *columns: str) -> Log:
    """The log without some of its columns."""
    return replace(log, table=log.table.drop(columns=list(columns)))


METHODS: dict[str, Callable[[Log], np.ndarray]] = {
    "last report, straight on (COG, SOG)": lambda log: reported(log, arc=False),
    "last report, on its arc (COG, SOG, heading, ROT)": lambda log: reported(log, arc=True),
    "course filter (positions alone)": lambda log: filtered(filter_course(log)),
    "planar filter (positions, heading)": lambda log: filtered(filter_log(without(log, "yaw_rate_deg_s"))),
    "planar filter (positions, heading, ROT)": lambda log: filtered(filter_log(log)),
    "the same with COG and SOG (filter_over_ground)": lambda log: filtered(filter_over_ground(log)),
    "the same, told that they are 2 s late": lambda log: filtered(filter_over_ground(log, delay=2.0)),
}


def errors(told: np.ndarray, log: Log, truth: pd.DataFrame) -> pd.DataFrame:
    """Errors at the full seconds: a method's state at its last report (n, 6), run on along the arc of its rate of turn."""
    time, at = truth["time_s"].to_numpy(), log.table["time_s"].to_numpy()
    last = np.searchsorted(at, time + 1e-6, side="right") - 1
    time, last, truth = time[last >= 0], last[last >= 0], truth[last >= 0]
    north, east, speed, course, heading, rate = told[last].T
    turned = rate * (time - at[last])
    way = speed * (time - at[last]) * np.sinc(turned / (2 * np.pi)) * np.exp(1j * (course + turned / 2))
    x, y = log.vessel.stations["gnss"]
    u, v, r, psi = (truth[c].to_numpy() for c in ("surge_m_s", "sway_m_s", "yaw_rate_rad_s", "heading_rad"))
    u, v = station_velocity(u, v, r, (x, y))
    midship = truth["north_m"].to_numpy() + 1j * truth["east_m"].to_numpy()
    antenna, found = midship + (x + 1j * y) * np.exp(1j * psi), north + 1j * east + way
    table = {
        "time_s": time,
        "turning": np.abs(r) > TURNING,
        "antenna_m": np.abs(found - antenna),
        "midship_m": np.abs(found - (x + 1j * y) * np.exp(1j * (heading + turned)) - midship),
        "course_deg": np.degrees(difference(course + turned, psi + np.arctan2(v, u))),
        "speed_m_s": speed - np.hypot(u, v),
        "heading_deg": np.degrees(difference(heading + turned, psi)),
    }
    return pd.DataFrame(table)[time >= SETTLED]


def study(count: int, late: float) -> dict[str, dict[str, dict[str, float]]]:
    """Root mean square errors of each method, over all, on straight courses and in turns; course and speed told `late` [s]."""
    logs, truths = voyages(count, late)
    gaps = np.concatenate([np.diff(log.table["time_s"]) for log in logs])
    print(f"\nCourse and speed over ground told {late:g} s late; {count} ships, {len(gaps) + count} reports,")
    print(f"intervals {gaps.min():g} to {gaps.max():g} s, {gaps.mean():.1f} s in the mean. Root mean square errors")
    found = {}
    for name, method in METHODS.items():
        table = pd.concat([errors(method(log), log, truth) for log, truth in zip(logs, truths, strict=True)])
        parts = {"all": table, "straight": table[~table["turning"]], "turning": table[table["turning"]]}
        found[name] = {
            part: {c: float(np.sqrt(np.mean(rows[c] ** 2))) for c in table.columns[2:]} for part, rows in parts.items()
        }
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--voyages", type=int, default=10)
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    found = {}
    for late in LATE:
        found[f"late_{late:g}_s"] = study(arguments.voyages, late)
        for part in ("all", "straight", "turning"):
            print(f"\n{part:50}antenna m  midship m  course deg  speed m/s  heading deg")
            for name, values in found[f"late_{late:g}_s"].items():
                print(f"{name:50}" + "".join(f"{value:10.2f} " for value in values[part].values()))
    if arguments.json:
        arguments.json.write_text(json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    main()
