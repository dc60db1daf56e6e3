"""Importer of the Esso Osaka free-running recordings: a 3 m model ship on a pond, 10 Hz, one CSV file per run.

The recordings are those of Wakita et al. 2022 (doi 10.1007/s00773-021-00867-1) and Miyauchi et al. 2022
(doi 10.1007/s00773-022-00889-3), CC BY-NC 4.0. What is odd in them is handled here, and counted in the log's notes:

- Position and heading are *held* for up to 2.5 s, together or one alone, and then catch up. A sample that repeats the one
  before it to the last bit is dropped; what follows is no jump.
- Steps beyond what the ship can do that follow no hold are GNSS jumps: counted here, rejected by the filter's gate.
- Velocities u and v are about 1 s late in the earth frame: not taken, the filter finds them from position and heading.
- The yaw rate of some runs is about 1 s late: its lag against the heading is estimated, and a late one is dropped.
- The rudder column is the order. The propeller column is taken as order and as speed; it is all that is recorded.
- Wind direction is where the wind blows from, in the pond's axes (the relative columns agree to 0.01 m/s).
- Empty rows, and the end of a run with the propeller stopped (the model was caught), are cut off.
"""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from aspnn.checks import check_log
from aspnn.records import Log
from aspnn.schema import InputError
from aspnn.vessel import load_vessel

SOURCE = "Esso Osaka free-running model, Wakita et al. 2022 and Miyauchi et al. 2022, CC BY-NC 4.0"
TIME, NORTH, EAST, HEADING = "t [s]", "x_position_mid [m]", "y_position_mid [m]", "psi_hat [rad]"
YAW_RATE, PROPELLER, RUDDER = "r_angvelo [rad/s]", "n_prop [rps]", "delta_rudder [rad]"
WIND_SPEED, WIND_FROM = "wind_velo_true [m/s]", "wind_dir_true [rad]"
FASTEST = 0.54  # m/s: the largest true step of the recordings, 0.054 m in 0.1 s
NOISE = 0.04  # m: what a step may add to it by noise; 0.09 m in one sample is a jump
LATE = 0.3  # s: a smaller lag of the yaw rate is within what the estimate can tell
TURNING = np.radians(0.2)  # rad/s: with a smaller standard deviation of the yaw rate there is nothing to compare


def import_esso_osaka(sources: Sequence[str | Path]) -> list[Log]:
    """Logs of recorded runs, from files or folders (searched through), in the order of their names.

    Positions are local north and east of midship; `notes` count what was dropped, and hold the `name` of each run. Parts of
    one recording share a voyage. Raises InputError naming file, row and column.
    """
    files = []
    for source in map(Path, sources):
        inside = sorted(source.rglob("*.csv")) if source.is_dir() else [source]
        if not inside:
            raise InputError(f"{source}: holds no .csv file; name the folder of the recordings, or the files")
        files += inside
    return [_log(file) for file in sorted(files, key=lambda file: file.name)]


def _log(file: Path) -> Log:
    table, empty = _read(file)
    stopped = np.flatnonzero(table[PROPELLER].to_numpy() != 0)
    end = len(table) if len(stopped) == 0 else int(stopped[-1]) + 1
    caught = len(table) - end
    table = table.iloc[:end]
    time, position = table[TIME].to_numpy(), table[[NORTH, EAST]].to_numpy(float, copy=True)
    heading, yaw_rate = table[HEADING].to_numpy(float, copy=True), table[YAW_RATE].to_numpy(float)
    held = np.concatenate([[False], (np.diff(position, axis=0) == 0).all(axis=1)])
    held_heading = np.concatenate([[False], np.diff(heading) == 0])
    lag = yaw_rate_lag(time, heading, yaw_rate, ~held_heading)
    position[held], heading[held_heading] = np.nan, np.nan
    notes: dict[str, Any] = {
        "name": file.stem,
        "empty_rows_dropped": empty,
        "rows_trimmed_after_stop": caught,
        "held_positions_dropped": int(held.sum()),
        "held_headings_dropped": int(held_heading.sum()),
        "position_jumps_left_to_gate": int(_jumps(time, position).sum()),
        "yaw_rate_lag_s": lag,
    }
    if lag > LATE:
        # Moved earlier it would tell a prediction what was measured after its start.
        yaw_rate = np.full(len(time), np.nan)
        notes["yaw_rate"] = "dropped, it is late"
    log = Log(
        table=pd.DataFrame(
            {
                "time_s": np.round(time - time[0], 6),
                "midship_north_m": position[:, 0],
                "midship_east_m": position[:, 1],
                "heading_deg": np.degrees(heading) % 360,
                "yaw_rate_deg_s": np.degrees(yaw_rate),
                "rudder_order_deg": np.degrees(table[RUDDER].to_numpy(float)),
                "engine_order_rps": table[PROPELLER].to_numpy(float),
                "shaft_speed_rps": table[PROPELLER].to_numpy(float),
                "wind_speed_true_m_s": table[WIND_SPEED].to_numpy(float),
                "wind_from_true_deg": np.degrees(table[WIND_FROM].to_numpy(float)) % 360,
            }
        ),
        vessel=load_vessel("esso_osaka"),
        source=SOURCE,
        voyage=re.sub(r"(_\d\d_\d\d_\d\d)_\d+$", r"\1", file.stem),
        notes=notes,
    )
    check_log(log, str(file))
    return log


def _read(file: Path) -> tuple[pd.DataFrame, int]:
    """The recorded table without its empty rows, and how many there were. Raises InputError."""
    try:
        table = pd.read_csv(file)
    except FileNotFoundError:
        raise InputError(f"{file}: no such file") from None
    except (ValueError, OSError) as error:
        raise InputError(f"{file}: cannot be read as CSV ({str(error).splitlines()[0]})") from None
    needed = (TIME, NORTH, EAST, HEADING, YAW_RATE, PROPELLER, RUDDER, WIND_SPEED, WIND_FROM)
    for name in needed:
        if name not in table:
            raise InputError(f"{file}: column {name} is missing; is it a recording of the Esso Osaka model?")
    full = table[list(needed)].dropna(how="all")
    if len(full) < 2:
        raise InputError(f"{file}: holds {len(full)} rows, at least 2 are needed")
    for name in needed:
        bad = pd.to_numeric(full[name], errors="coerce").isna()
        if bad.any():
            row = int(np.argmax(bad.to_numpy()))
            raise InputError(f"{file}: row {full.index[row]}, column {name}: {full[name].iloc[row]!r} is not a number")
    return full.astype(float).reset_index(drop=True), len(table) - len(full)


def _jumps(time: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Steps between known positions that the ship cannot have made in the time between them."""
    known = np.isfinite(position[:, 0])
    step = np.linalg.norm(np.diff(position[known], axis=0), axis=1)
    return step > FASTEST * np.diff(time[known]) + NOISE


def yaw_rate_lag(time: np.ndarray, heading: np.ndarray, yaw_rate: np.ndarray, known: np.ndarray) -> float:
    """How late [s] the yaw rate [rad/s] is against the derivative of the heading [rad]; 0 where it cannot be told.

    The lag of up to 2 s with the highest correlation, if it leaves at most 0.8 of what no lag leaves unexplained: in a
    steady turn every lag does equally well. The derivative is taken over 2 s about each epoch, where the heading is
    `known` throughout; epochs are about evenly spaced.
    """
    step = float(np.median(np.diff(time)))
    half = max(1, round(1.0 / step))
    psi = np.unwrap(heading)
    rate = np.full(len(psi), np.nan)
    rate[half:-half] = (psi[2 * half :] - psi[: -2 * half]) / (time[2 * half :] - time[: -2 * half])
    fresh = (np.convolve(~known, np.ones(2 * half + 1), "same") == 0) & np.isfinite(rate)
    left = {}  # share of the turning that each lag leaves unexplained
    for lag in range(-round(2.0 / step), round(2.0 / step) + 1):
        late, early = yaw_rate[max(lag, 0) : len(psi) + min(lag, 0)], slice(max(-lag, 0), len(psi) - max(lag, 0))
        use = fresh[early] & np.isfinite(late)
        moving = use.sum() > 100 and min(np.std(late[use]), np.std(rate[early][use])) > TURNING
        left[lag] = 1 - float(np.corrcoef(late[use], rate[early][use])[0, 1]) if moving else 1.0
    best = min(left, key=lambda lag: left[lag])
    return round(best * step, 6) if left[best] < 0.8 * left[0] else 0.0
