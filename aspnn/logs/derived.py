"""Derived columns: rudder orders found from a recorded rudder angle, where nobody recorded the orders themselves."""

from itertools import pairwise

import numpy as np
import pandas as pd

from aspnn.orders import Orders

LEAST = np.radians(1.0)  # smallest change of level that is an order; below it lies course-keeping and measuring noise
GRADE = np.radians(0.5)  # orders are given in whole or half degrees
QUANTUM = np.radians(1.0)  # no rudder indicator is coarser
STEEP = 0.2  # part of the steering gear's rate: a small change that is slower is drift of the sensor, not an order

Move = tuple[int, int]  # first and last sample of a movement of the rudder


def rudder_orders(time, angle, rate: float) -> Orders:
    """The rudder orders [rad] behind a measured `angle` [rad] at `time` [s]; NaN: no sample. `rate` [rad/s]: of the gear.

    A steering gear moves at a limited rate and then rests: the order is the level at which it comes to rest (or turns
    back, when the next order comes first), and its instant is where the movement begins, found by running the line of the
    movement back to the level before. Two orders to the same side without a rest between them are found as one. Levels are
    rounded to half a degree, so that noise of 0.02 does not hide a change of 5 degrees.
    """
    time, angle = np.asarray(time, float), np.asarray(angle, float)
    known = np.isfinite(time) & np.isfinite(angle)
    time, angle = time[known], angle[known]
    if len(time) == 0:
        return Orders.held(np.nan)
    samples = max(1, int(3 * LEAST / rate / np.median(np.diff(time)))) if len(time) > 1 else 1
    smooth = pd.Series(angle).rolling(5, center=True, min_periods=1).median()  # takes spikes away, leaves corners
    smooth = smooth.rolling(samples, center=True, min_periods=1).mean().to_numpy()  # bends corners by 3/8 of LEAST
    tolerance = _tolerance(angle, samples)
    moves = _moves(time, smooth, _corners(time, smooth, tolerance), tolerance, rate)
    levels = _levels(angle, smooth, moves, tolerance)
    while np.any(np.abs(np.diff(levels)) < LEAST):
        moves = [m for m, change in zip(moves, np.diff(levels), strict=True) if abs(change) >= LEAST]
        levels = _levels(angle, smooth, moves, tolerance)
    times, end = [time[0]], 0
    for move, (before, after) in zip(moves, pairwise(levels), strict=True):
        times.append(np.clip(_begin(time, angle, smooth, move, before, after, rate), time[end], time[move[1]]))
        end = move[1]
    return Orders(np.array(times), np.round(levels / GRADE) * GRADE + 0.0)


def with_rudder_orders(table: pd.DataFrame, rate: float) -> tuple[pd.DataFrame, dict[str, str]]:
    """A log's table with `rudder_order_deg` derived where only `rudder_angle_deg` is recorded, and the note that says so.

    `rate` [rad/s] is that of the steering gear. A table with recorded orders, or without angles, comes back as it is, with
    no note. Rows before the first angle have no order.
    """
    recorded = "rudder_order_deg" in table and table["rudder_order_deg"].notna().any()
    if recorded or "rudder_angle_deg" not in table or not table["rudder_angle_deg"].notna().any():
        return table, {}
    time = table["time_s"].to_numpy(float)
    orders = rudder_orders(time, np.radians(table["rudder_angle_deg"].to_numpy(float)), rate)
    held = np.where(time >= orders.times[0], np.round(np.degrees(orders.at(time)), 6), np.nan)
    note = f"derived from rudder_angle_deg, {len(orders.times)} orders"
    return table.assign(rudder_order_deg=held), {"rudder_order_deg": note}


def _tolerance(angle: np.ndarray, samples: int) -> float:
    """How far [rad] the angle, smoothed over `samples`, may stray from straight lines.

    Noise by the median absolute second difference (in which steady movement cancels), and the step of a coarse indicator.
    """
    steps = np.abs(np.diff(angle))
    steps = steps[steps > 1e-6]
    quantum = min(float(steps.min()), QUANTUM) if len(steps) else 0.0
    noise = 1.4826 * float(np.median(np.abs(np.diff(angle, 2)))) / np.sqrt(6) if len(angle) > 2 else 0.0
    left = min(0.535, 1.2 / np.sqrt(samples))  # of white noise after a running median of 5, and after the mean
    return max(LEAST / 2, 1.25 * quantum, 5 * left * noise)


def _corners(time: np.ndarray, angle: np.ndarray, tolerance: float) -> np.ndarray:
    """Samples between which the angle runs in straight lines within `tolerance` (Ramer-Douglas-Peucker, vertically)."""
    keep, open_ = {0, len(time) - 1}, [(0, len(time) - 1)]
    while open_:
        first, last = open_.pop()
        if last - first < 2:
            continue
        inside = slice(first + 1, last)
        slope = (angle[last] - angle[first]) / (time[last] - time[first])
        stray = np.abs(angle[inside] - angle[first] - slope * (time[inside] - time[first]))
        worst = first + 1 + int(np.argmax(stray))
        if stray.max() > tolerance:
            keep.add(worst)
            open_ += [(first, worst), (worst, last)]
    return np.array(sorted(keep))


def _moves(time: np.ndarray, angle: np.ndarray, knots: np.ndarray, tolerance: float, rate: float) -> list[Move]:
    """The movements: straight lines that are steep or long, joined where they follow each other to the same side.

    Noise puts corners up to `tolerance` off on either side, so a slow line that rises by less than twice that is a rest.
    """
    moves: list[Move] = []
    for first, last in pairwise(knots):
        change = angle[last] - angle[first]
        steep = last - first == 1 or abs(change) >= STEEP * rate * (time[last] - time[first])
        if not steep and abs(change) < 2 * tolerance:
            continue
        if moves and moves[-1][1] == first and change * (angle[first] - angle[moves[-1][0]]) > 0:
            first = moves.pop()[0]
        moves.append((int(first), int(last)))
    return moves


def _levels(angle: np.ndarray, smooth: np.ndarray, moves: list[Move], tolerance: float) -> np.ndarray:
    """Angle [rad] at rest before, between and after the movements; where one follows another at once, that of the turn."""
    ends = [0, *(last for _, last in moves)]
    begins = [*(first for first, _ in moves), len(angle) - 1]
    levels = []
    for begin, end in zip(ends, begins, strict=True):
        rest = angle[begin : end + 1]
        middle = np.median(rest) if end - begin >= 4 else smooth[(begin + end) // 2]
        near = np.abs(rest - middle) <= tolerance
        levels.append(rest[near].mean() if near.any() else middle)
    return np.array(levels)


def _begin(
    time: np.ndarray, angle: np.ndarray, smooth: np.ndarray, move: Move, before: float, after: float, rate: float
) -> float:
    """The instant [s] at which a movement leaves its level: the line through its middle part, run back.

    With fewer than three samples in the middle part, half the movement at the gear's `rate` before the angle is half way.
    """
    first, last = move
    t, raw, part = (x[first : last + 1] for x in (time, (angle - before) / (after - before), smooth))
    part = (part - before) / (after - before)
    past = int(np.argmax(part >= 0.5)) if (part >= 0.5).any() else len(part) - 1
    low = int(np.flatnonzero(part[: past + 1] <= 0.2)[-1]) + 1 if (part[:past] <= 0.2).any() else 0
    high = past + int(np.argmax(part[past:] >= 0.8)) if (part[past:] >= 0.8).any() else len(part)
    if high - low >= 3:
        slope, intercept = np.polyfit(t[low:high] - t[0], raw[low:high], 1)
        if slope > 0:
            return t[0] - intercept / slope
    here = max(past - 1, 0)
    half = float(np.interp(0.5, part[here : past + 1], t[here : past + 1]))
    return half - abs(after - before) / 2 / rate
