"""Which ship is this today: what a log tells of the ship that made it, as text. What `aspnn track` prints."""

import math
from pathlib import Path

import numpy as np

from aspnn import records
from aspnn.estimation import filter_log
from aspnn.estimation.steering import Steering, track_steering
from aspnn.workflow.filtering import states_for

EVERY = 300.0  # s between the rows that are shown


def track_file(log: str | Path, checkpoint: str | Path | None = None) -> list[str]:
    """Lines: Nomoto's K' and T' of a log every five minutes, and the corrections of a checkpoint with their standard errors.

    Raises InputError, also for a checkpoint that cannot be tracked or is of another ship.
    """
    read = records.read_log(log)
    if checkpoint is None:
        return steering_lines(track_steering(filter_log(read)), read.vessel.length, read.vessel.service_speed)
    predictor = tracked(checkpoint)
    states = states_for(read, predictor.spec)
    lines = steering_lines(track_steering(states), read.vessel.length, read.vessel.service_speed)
    return [*lines, "", *correction_lines(predictor, states)]


def tracked(checkpoint: str | Path):
    """The tracked predictor of a checkpoint folder or an .onnx file. Raises InputError."""
    from aspnn.prediction import Predictor
    from aspnn.prediction.tracked import Tracked

    return Tracked(Predictor.load(checkpoint))


def steering_lines(found: Steering, length: float, speed: float) -> list[str]:
    """A table of Nomoto's constants, the last row the end of the log, and what they are at service speed [m/s]."""
    lines = [
        "steering (Nomoto, K' = K L / U, T' = T U / L), standard errors after ±",
        "  min  K'            T'            neutral rudder deg",
    ]
    marks = np.arange(found.time[0] + EVERY, found.time[-1], EVERY)
    rows = np.unique(np.append(np.searchsorted(found.time, marks), len(found.time) - 1))
    for k in rows:
        sd = found.sd[k]
        neutral = f"{math.degrees(found.neutral[k]):+.2f} ± {math.degrees(sd[2]):.2f}"
        gain, time = f"{found.gain[k]:5.2f} ± {sd[0]:.2f}", f"{found.time_constant[k]:5.2f} ± {sd[1]:.2f}"
        lines.append(f"{(found.time[k] - found.time[0]) / 60:5.1f}  {gain}  {time}  {neutral}")
    if not found.excited.any():
        return [*lines, "the rudder hardly moved, so these are what was believed beforehand"]
    K, T = found.at(length, speed)
    square = float(np.nanmean(found.square))
    lines.append(
        f"at {speed:.1f} m/s: K {K[-1]:.4f} 1/s, T {T[-1]:.1f} s; squared innovations {square:.2f} of their variance"
    )
    return lines


def correction_lines(predictor, states) -> list[str]:
    """The corrections at the end of the states, one a line, and whether they are used."""
    from aspnn.prediction.similarity import NAMES

    now = predictor.estimate(states)
    lines = [
        f"corrections of {predictor.contract.name} after {(states['time_s'][-1] - states['time_s'][0]) / 60:.1f} min"
    ]
    for name, value, sd in zip(NAMES, now.parameters, np.sqrt(np.diag(now.covariance)), strict=True):
        if name == "neutral":
            lines.append(f"  {name:9s}{math.degrees(value):+.2f} ± {math.degrees(sd):.2f} deg")
        elif name in ("lean", "swing"):
            lines.append(f"  {name:9s}{value:+.3f} ± {sd:.3f}")
        else:
            lines.append(f"  {name:9s}{100 * math.expm1(value):+.1f} ± {100 * math.exp(value) * sd:.1f} %")
    north, east = now.current
    used = "used" if now.sure else "not used: the ship is as good as that of the training, or too little is known"
    return [*lines, f"  current {math.hypot(north, east):.2f} m/s; gain {now.gain:.0f}: {used}"]
