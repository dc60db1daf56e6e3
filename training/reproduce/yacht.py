"""The filter on a real full-size yacht: is it consistent, does it find what is wrong with its sensors, does it predict others?

    python training/reproduce/yacht.py [FOLDER] [--settle 10]

FOLDER holds the decoded NMEA 2000 recordings of a wide turn and of a fast figure-8 (default ../shared/data/n2k_yacht beside
the project; they are not part of it). The noise of the vessel was tuned on the wide turn, so the figure-8 is a test of it.
Prints, for each recording: consistency per sensor; the yaw rate from the compass alone beside an independent gyro; how late
three sensors are; what the gate rejected; what the lever arm of the antenna does; and the positions of a second GPS, which the
filter never sees.
"""

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from aspnn.cli import guarded, say
from aspnn.estimation import filter_log, smooth_log
from aspnn.estimation.cascade import run_cascade
from aspnn.estimation.lag import lag
from aspnn.estimation.sensors import sensors, summarise
from aspnn.frames import station_velocity, to_grid
from aspnn.logs.n2k_yacht import DEFAULT, Antenna, Told, import_n2k_yacht
from aspnn.records import Log
from aspnn.schema import InputError
from aspnn.vessel import load_vessel

FOLDER = Path(__file__).parents[3] / "shared/data/n2k_yacht"
SLOW = 60.0  # s: what varies over longer than this is the wander of a GPS
VESSEL = load_vessel("n2k_yacht")
GPS = Antenna(source=25, station_m=VESSEL.stations["gps"])
BOTH = DEFAULT.model_copy(update={"antennas": DEFAULT.antennas | {"gps": GPS}})  # rows at the times of the GPS too
OWN = Told(heading=52, yaw_rate=52, over_ground=52)  # what the satellite compass makes of rate and course
OTHER = DEFAULT.model_copy(update={"sensors": OWN})


def without(log: Log, *beginnings: str) -> Log:
    """The log without the columns that begin so; its rows stay."""
    return replace(log, table=log.table.drop(columns=[c for c in log.table if c.startswith(beginnings)]))


def known(log: Log, column: str) -> tuple[np.ndarray, np.ndarray]:
    """Times and values where the log has a value. Raises InputError where it has none."""
    if column not in log.table:
        raise InputError(f"{log.voyage}: has no {column}; the study needs what sources 25, 27 and 52 send")
    values = log.table[column].to_numpy(float)
    return log.table["time_s"].to_numpy(float)[np.isfinite(values)], values[np.isfinite(values)]


def told(found: tuple[float, float]) -> str:
    """A lag and its standard error in words."""
    return f"{found[0]:.2f} +- {found[1]:.3f} s late" if np.isfinite(found[1]) else "cannot be told (too steady)"


def consistency(what: str, log: Log, settle: float) -> Iterator[str]:
    """A row of the table per sensor."""
    for s in summarise(run_cascade(log), settle):
        yield (
            f"| {what} | {s.sensor} | {s.n} | {s.mean_nis:.2f} | {100 * s.shares.inside:.1f} | {100 * s.shares.below:.1f} | "
            f"{100 * s.shares.above:.1f} | {s.autocorrelation:.2f} | {s.bias:+.1f} | {100 * s.rejected:.1f} |"
        )


def yaw_rates(log: Log, other: Log, settle: float) -> Iterator[str]:
    """The compass alone against the gyro (source 27), and the lags of the satellite compass's own rate and course."""
    compass_only = without(log, "yaw_rate")
    time, gyro = known(log, "yaw_rate_deg_s")
    turn, heading = known(log, "heading_deg")
    heading = np.degrees(np.unwrap(np.radians(heading)))
    late = {"filtered": filter_log(compass_only), "smoothed": smooth_log(compass_only)}
    use = (time > time[0] + settle) & (time < time[-1] - settle)
    for name, states in late.items():
        rate = np.degrees(np.interp(time, states["time_s"], states["yaw_rate_rad_s"]))
        off = (rate - gyro)[use]
        yield (
            f"yaw rate from the compass alone, {name}, beside the gyro: correlation {np.corrcoef(rate[use], gyro[use])[0, 1]:.4f}, "
            f"rms {off.std():.3f} deg/s, median {np.median(np.abs(off)):.3f} deg/s"
        )
    gained = np.concatenate([[0.0], np.cumsum(np.diff(time) * (gyro[1:] + gyro[:-1]) / 2)])
    both = [np.interp(time + 0.5, t, v) - np.interp(time - 0.5, t, v) for t, v in ((turn, heading), (time, gained))]
    yield f"turn of the compass over 1 s beside that of the gyro: correlation {np.corrcoef(both[0][use], both[1][use])[0, 1]:.4f}"
    ten = [np.interp(time + 5, t, v) - np.interp(time - 5, t, v) for t, v in ((turn, heading), (time, gained))]
    factor = ten[0][use] @ ten[1][use] / (ten[1][use] @ ten[1][use])
    yield f"turn of the compass over 10 s: {100 * (factor - 1):+.1f} % beside that of the gyro"
    alone, states = late["smoothed"], smooth_log(log)
    turning = np.degrees(alone["yaw_rate_rad_s"])
    yield f"rate of turn of source 27, against the compass alone: {told(lag(time, gyro, alone['time_s'], turning))}"
    at, rate = states["time_s"], np.degrees(states["yaw_rate_rad_s"])
    yield f"rate of turn of source 52: {told(lag(*known(other, 'yaw_rate_deg_s'), at, rate))}"
    ahead, aside = station_velocity(
        states["surge_m_s"], states["sway_m_s"], states["yaw_rate_rad_s"], log.vessel.stations["compass"]
    )
    course = np.unwrap(states["heading_rad"] + states["convergence_rad"] + np.arctan2(aside, ahead))
    when, recorded = known(other, "course_over_ground_deg")
    yield f"course over ground of source 52: {told(lag(when, np.unwrap(np.radians(recorded)), at, course))}"


def gated(log: Log) -> Iterator[str]:
    """Rejected values, those within a second of each other together."""
    for s in sensors(run_cascade(log)):
        rows = np.flatnonzero(s.rejected)
        starts = [0, *(np.flatnonzero(np.diff(s.time[rows]) > 1.0) + 1), len(rows)] if len(rows) else [0]
        groups = [f"{s.time[rows[a]]:.2f} to {s.time[rows[b - 1]]:.2f} s ({b - a})" for a, b in pairwise(starts)]
        yield f"gated, {s.name}: {', '.join(groups) or 'nothing'}"
    for column in ("heading_deg", "compass_latitude_deg"):
        time, _ = known(log, column)
        still = int(np.argmax(np.diff(time)))
        late = log.notes.get("late_values_left_to_gate", {}).get(column, 0)
        yield (
            f"longest silence of {column}: {np.diff(time)[still]:.2f} s, from {time[still]:.2f} to {time[still + 1]:.2f} s; "
            f"values that came late, in a burst: {late}"
        )


def fixes(log: Log, antenna: str) -> tuple[np.ndarray, np.ndarray]:
    """Times and positions, north + i east [m], of an antenna."""
    time, latitude = known(log, f"{antenna}_latitude_deg")
    north, east = to_grid(np.radians(latitude), np.radians(known(log, f"{antenna}_longitude_deg")[1]), log.zone)
    return time, north + 1j * east


@dataclass(frozen=True)
class Apart:
    """How far source 25 is from a track (n), north + i east [m], and the grid heading there as exp(i psi)."""

    time: np.ndarray
    offset: np.ndarray
    bow: np.ndarray

    def station(self) -> complex:
        """Where in body axes, forward + i starboard [m], it is on average, if it is off by a constant on the ground besides."""
        return complex(
            np.linalg.lstsq(np.column_stack([self.bow, np.ones_like(self.bow)]), self.offset, rcond=None)[0][0]
        )

    def line(self, station: complex = 0j) -> str:
        """Mean offset, rms about it and about its running mean, with the antenna at `station` from the track."""
        off = self.offset - station * self.bow
        low, high = (np.searchsorted(self.time, self.time + side * SLOW / 2) for side in (-1, 1))
        total = np.concatenate([[0], np.cumsum(off)])
        rms = [np.sqrt(np.mean(np.abs(off - m) ** 2)) for m in (off.mean(), (total[high] - total[low]) / (high - low))]
        return f"{abs(off.mean()):.2f} | {rms[0]:.2f} | {rms[1]:.2f}"


def held_out(both: Log, settle: float) -> dict[str, Apart]:
    """Source 25 beside the filter's midship (with the lever arm and without) and beside the raw positions of source 52."""
    time, place = fixes(both, "gps")
    use = time > settle
    time, place = time[use], place[use]
    seen, found = without(both, "gps_"), {}
    bare = replace(seen, vessel=both.vessel.with_stations(compass=(0.0, 0.0)))
    for name, log in (("filtered, with the lever arm", seen), ("filtered, without it", bare)):
        states = filter_log(log)
        row = np.searchsorted(states["time_s"], time)
        bow = np.exp(1j * states["heading_rad"][row])
        found[name] = Apart(time, place - states["north_m"][row] - 1j * states["east_m"][row], bow)
    at, raw = fixes(both, "compass")
    found["raw positions of 52"] = Apart(time, place - np.interp(time, at, raw), bow)
    return found


def lever_arm(log: Log, settle: float) -> Iterator[str]:
    """What the filter makes of the antenna's positions with its station, and as if it stood at midship."""
    bare = replace(log, vessel=log.vessel.with_stations(compass=(0.0, 0.0)))
    gain = run_cascade(log).moving.log_likelihood - run_cascade(bare).moving.log_likelihood
    for name, by in (("with the lever arm", log), ("without it", bare)):
        s = next(s for s in summarise(run_cascade(by), settle) if s.sensor == "compass")
        states = filter_log(by)
        drift = np.degrees(states["drift_rad"][states["time_s"] > settle])
        yield (
            f"{name}: NIS of the antenna {s.mean_nis:.2f} per dof, {100 * s.shares.inside:.1f} % inside; "
            f"drift angle {drift.mean():+.1f} deg, deviation {drift.std():.1f} deg"
        )
    yield f"log-likelihood gained by the lever arm: {gain:+.0f}"


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("folder", nargs="?", type=Path, default=FOLDER)
    options.add_argument("--settle", type=float, default=10.0, help="seconds left out at the start")
    given = options.parse_args()
    logs, unseen = import_n2k_yacht([given.folder]), {}
    for log, both, other in zip(
        logs, import_n2k_yacht([given.folder], BOTH), import_n2k_yacht([given.folder], OTHER), strict=True
    ):
        say(False, f"\n{log.voyage}: {len(log)} rows, {log.table['time_s'].iloc[-1]:.0f} s, zone {log.zone}")
        say(
            False,
            "| filter fed with | sensor | n | NIS per dof | % inside | below | above | lag-1 | bias/se | % gated |",
        )
        say(False, "|---|---|---|---|---|---|---|---|---|---|")
        for what, fed in (("gyro (27)", log), ("no rate", without(log, "yaw_rate")), ("rate of 52", other)):
            for line in consistency(what, fed, given.settle):
                say(False, line)
        for part in (yaw_rates(log, other, given.settle), gated(log), lever_arm(log, given.settle)):
            for line in part:
                say(False, f"- {line}")
        unseen[log.voyage] = held_out(both, given.settle)
    say(
        False,
        "\nSource 25, which no filter was given. Its station is assumed at midship, or is that of the other recordings.",
    )
    say(False, f"| recording | track | station | m off | rms about that | rms about its mean over {SLOW:g} s |")
    say(False, "|---|---|---|---|---|---|")
    for voyage, tracks in unseen.items():
        for name, track in tracks.items():
            say(False, f"| {voyage} | {name} | assumed | {track.line()} |")
            others = [found[name].station() for other, found in unseen.items() if other != voyage]
            if others:
                station = complex(np.mean(others))
                say(False, f"| {voyage} | {name} | {station.real:.1f}, {station.imag:.1f} | {track.line(station)} |")


if __name__ == "__main__":
    guarded(main)
