"""The course filter on recordings: a yacht's satellite compass, and a model ship on a pond, each against what its own receiver told.

Nothing is tuned to them: the filter's densities come from the length and service speed of the vessel, its position noise from the
vessel file. Positions alone are used, of the yacht those of source 52.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd
from yacht import OTHER, known

from aspnn.angles import wrap
from aspnn.estimation import smooth_log
from aspnn.estimation.course import filter_course
from aspnn.estimation.lag import lag
from aspnn.frames import station_velocity
from aspnn.logs.esso_osaka import HEADING, TIME, import_esso_osaka
from aspnn.logs.n2k_yacht import import_n2k_yacht
from aspnn.records import Log, States
from aspnn.schema import InputError, antennas

GLITCH = (
    130.0,
    150.0,
)  # s of the figure-8: a glitch of position and yaw at 135 s, and what the receiver's own filter makes of it
SETTLE = 20.0  # s
LATE = 1.0  # s: by so much the pond's recorded velocities are late in the earth frame (../shared/data/README.md)
SLOWEST = 0.15  # m/s, below which the pond's recorded course says nothing
SURE = 0.3  # s: a lag with a larger standard error does not count in the median
LASTING = 5.0  # s for which the model must have been faster; a hand that lifts it out is quicker than any filter


@dataclass(frozen=True)
class Score:
    """Rms of course [deg] and speed [m/s] over `samples` of a recording, by the recorder's own values less its lags [s].

    `own` are our lags of course and speed against the full filter, smoothed, with heading; those of a pair are value and
    standard error.
    """

    name: str
    samples: int
    course: float
    speed: float
    recorded: tuple[tuple[float, float], tuple[float, float]] | None = None
    own: tuple[tuple[float, float], tuple[float, float]] | None = None


def positions(log: Log) -> Log:
    """The log with nothing but time and positions."""
    names = antennas(log.table.columns)
    return replace(log, table=log.table[["time_s", *(c for c in log.table if c.split("_")[0] in names)]])


def rms(values: np.ndarray) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(values**2)))


def over_ground(states: States, station: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Speed [m/s] and course [rad, grid, continuous] of a station by the states of a filter with heading."""
    u, v = station_velocity(states["surge_m_s"], states["sway_m_s"], states["yaw_rate_rad_s"], station[:2])
    return np.hypot(u, v), np.unwrap(states["heading_rad"] + np.arctan2(v, u))


def lags(log: Log, ours: States, use: np.ndarray) -> tuple[tuple[float, float], tuple[float, float]]:
    """How late our course and our speed are in the rows `use` against the full filter with heading and gyro, smoothed."""
    antenna = next(c for c in ours.table if str(c).startswith("nis_")).removeprefix("nis_")
    speed, course = over_ground(smooth_log(log), log.vessel.stations[antenna])
    time = ours["time_s"]
    pairs = (np.unwrap(ours["course_rad"]), course), (ours["speed_over_ground_m_s"], speed)
    first, second = (lag(time[use], mine[use], time, full, 8.0) for mine, full in pairs)
    return first, second


def yacht(folder: Path) -> Iterator[Score]:
    """Each recording of the yacht: our course and speed at source 52's antenna against its own course and speed over ground."""
    for file in sorted(folder.glob("*.csv")):
        log = import_n2k_yacht([file], OTHER)[0]
        ours, full = filter_course(positions(log)), smooth_log(log)
        time, course, speed = ours["time_s"], ours["course_rad"], ours["speed_over_ground_m_s"]
        their_speed, their_course = over_ground(full, log.vessel.stations["compass"])
        turns, told = known(log, "course_over_ground_deg")
        paces, sog = known(log, "speed_over_ground_m_s")
        cog = np.unwrap(np.radians(told)) - np.interp(turns, time, ours["convergence_rad"])
        late = lag(turns, cog, time, their_course), lag(paces, sog, time, their_speed)
        # A speed that hardly changes does not tell its lag; one receiver filters both alike.
        delay = late[0][0], late[1][0] if late[1][1] < 0.5 else late[0][0]
        use = [(t > SETTLE) & (t < time[-1]) & ~((t > GLITCH[0]) & (t < GLITCH[1])) for t in (turns, paces)]
        off = wrap(cog - np.interp(turns - delay[0], time, course))[use[0]]
        slower = (sog - np.interp(paces - delay[1], time, speed))[use[1]]
        keep = (time > SETTLE) & ~((time > GLITCH[0]) & (time < GLITCH[1]))
        yield Score(file.stem, len(off), float(np.degrees(rms(off))), rms(slower), late, lags(log, ours, keep))


def pond(folder: Path) -> Iterator[Score]:
    """Each run on the pond: our course and speed against the recorded velocity, turned to the earth frame and shifted by its lag."""
    for log in import_esso_osaka([folder]):
        file = next(folder.rglob(f"{log.notes['name']}.csv"))
        raw = pd.read_csv(file).dropna()
        then = raw[TIME].to_numpy(float) - float(raw[TIME].iloc[0])
        velocity = np.exp(1j * raw[HEADING].to_numpy()) * (raw["u_velo [m/s]"] + 1j * raw["vm_velo [m/s]"]).to_numpy()
        states = filter_course(positions(log))
        time = states["time_s"]
        at = np.interp(time + LATE, then, velocity.real) + 1j * np.interp(time + LATE, then, velocity.imag)
        fast = np.abs(at) > SLOWEST
        since = time - np.maximum.accumulate(np.where(fast, -np.inf, time))
        use = (time > SETTLE) & (time + LATE <= then[-1]) & (since > LASTING) & ~states["coasting"].astype(bool)
        if use.any():
            course = wrap(states["course_rad"] - np.angle(at))[use]
            speed = (states["speed_over_ground_m_s"] - np.abs(at))[use]
            yield Score(
                log.notes["name"],
                int(use.sum()),
                float(np.degrees(rms(course))),
                rms(speed),
                own=lags(log, states, use),
            )


def together(scores: list[Score], name: str) -> Score:
    """The rms over the samples of all."""
    n = np.array([s.samples for s in scores])
    course, speed = (
        float(np.sqrt(n @ np.square(x) / n.sum())) for x in zip(*((s.course, s.speed) for s in scores), strict=True)
    )
    return Score(name, int(n.sum()), course, speed)


def lines(shared: Path) -> Iterator[str]:
    """The tables of both recordings, or why there is none."""
    folder = shared / "n2k_yacht"
    if folder.is_dir():
        yield "| yacht | samples | course (deg rms) | speed (m/s rms) | COG late (s) | SOG late (s) | our course late (s) | our speed late (s) |"
        yield "|---|---|---|---|---|---|---|---|"
        for s in yacht(folder):
            assert s.recorded is not None and s.own is not None
            cells = " | ".join(told(pair) for pair in (*s.recorded, *s.own))
            yield f"| {s.name} | {s.samples} | {s.course:.2f} | {s.speed:.3f} | {cells} |"
    else:
        yield f"{folder} is absent: the yacht's recordings are not part of the project, and nothing is said of them"
    folder = shared / "esso_osaka"
    if not folder.is_dir():
        yield f"{folder} is absent: the model ship's recordings are not part of the project, and nothing is said of them"
        return
    scores = list(pond(folder))
    if not scores:
        raise InputError(f"{folder}: no run is faster than {SLOWEST:g} m/s for {LASTING:g} s")
    yield ""
    yield f"| pond, above {SLOWEST:g} m/s | samples | course (deg rms) | speed (m/s rms) | our course late (s) | our speed late (s) |"
    yield "|---|---|---|---|---|---|"
    for s in scores:
        assert s.own is not None
        yield f"| {s.name} | {s.samples} | {s.course:.2f} | {s.speed:.4f} | {told(s.own[0])} | {told(s.own[1])} |"
    s = together(scores, f"all {len(scores)} runs")
    middle = [np.median([x.own[k][0] for x in scores if x.own is not None and x.own[k][1] < SURE]) for k in (0, 1)]
    yield f"| {s.name} | {s.samples} | {s.course:.2f} | {s.speed:.4f} | median {middle[0]:.2f} | median {middle[1]:.2f} |"


def told(pair: tuple[float, float]) -> str:
    """A lag with its standard error, or that it cannot be told."""
    return f"{pair[0]:.2f} +- {pair[1]:.2f}" if np.isfinite(pair[1]) else "cannot be told"
