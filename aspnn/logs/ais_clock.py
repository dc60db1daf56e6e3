"""When AIS reports were true: their own UTC second, unwrapped by the time of receipt, else by base stations and by their order.

A report tells only the second of the minute in which its fix was taken. Which minute it was, the time of receipt tells: reports
come late by what the radio slot, the station and the network take, and that is less than half a minute off its own mean for one
ship. (Should it be more, the report stands a whole minute off, and its position jumps: see `tracks`.)
"""

import numpy as np

MINUTE = 60.0
EARLY = (
    15.0  # s: so much may a report's own second be ahead of the clock of whoever received it, or reports out of order
)
BASE = 1.0  # s: base stations keep UTC; a larger difference is the clock of the logger
RECENT = 9  # reports, of which the median tells about what time it is where nobody received them


def folded(difference, middle=0.0):
    """`difference` [s] by whole minutes to within half a minute of `middle`."""
    return middle + (np.asarray(difference, float) - middle + MINUTE / 2) % MINUTE - MINUTE / 2


def _late(difference):
    """A difference [s] by whole minutes to what a delay can be: EARLY before to the rest of the minute after."""
    return (np.asarray(difference, float) + EARLY) % MINUTE - EARLY


def _mean(lateness: np.ndarray) -> float:
    """Mean of `lateness` [s] on the circle of a minute."""
    return float(np.angle(np.mean(np.exp(2j * np.pi * lateness / MINUTE))) * MINUTE / (2 * np.pi))


def clock(received, second, base, ship) -> tuple[np.ndarray, bool, float]:
    """The time [s, UNIX] of each message in the order of the file, NaN where it cannot be told; whether the day is known; and by
    how much [s] the clock of receipt was ahead of the base stations'.

    `received` [s, UNIX], the report's own UTC `second` [s], the time of a `base` station [s, UNIX]: all (n), NaN where there
    is none. `ship` (n): who sent it. Reports without a second stand at their receipt. Reports that nobody timed follow each other:
    each within EARLY before and 45 s after those around it, from base stations forward and back; where a gap leaves forward and
    back at odds they have no time.
    """
    received, second, base = (np.array(x, float) for x in (received, second, base))
    ship, both = np.asarray(ship), np.isfinite(received) & np.isfinite(base)
    ahead = float(np.median((received - base)[both])) if both.any() else 0.0
    ahead = ahead if abs(ahead) > BASE else 0.0
    received = received - ahead
    time = np.where(np.isfinite(received), received, base)
    own = np.isfinite(received) & np.isfinite(second)
    if own.any():
        late = np.where(own, received - second, np.nan)
        usual = float(_late(_mean(late[own])))
        for sender in np.unique(ship[own]):
            rows = own & (ship == sender)
            middle = float(folded(_mean(late[rows]), usual))
            time[rows] = np.round(received[rows] - folded(late[rows], middle))
    dated = bool(np.isfinite(time).any())
    if not dated:
        first = np.flatnonzero(np.isfinite(second))
        time[first[:1]] = second[first[:1]]
    return _by_order(time, second), dated, ahead


def _by_order(time: np.ndarray, second: np.ndarray) -> np.ndarray:
    """`time` [s], where it is not known by the `second` and the order."""
    anchors, open_ = np.isfinite(time), np.flatnonzero(np.isnan(time) & np.isfinite(second))
    if not anchors.any() or len(open_) == 0:
        return time
    forth, back = _follow(time, second, 1), _follow(time[::-1], second[::-1], -1)[::-1]
    before, after = open_ < np.argmax(anchors), open_ > np.flatnonzero(anchors)[-1]
    agreed = np.where(forth[open_] == back[open_], forth[open_], np.nan)
    time = time.copy()
    time[open_] = np.where(before, back[open_], np.where(after, forth[open_], agreed))
    return time


def _follow(time: np.ndarray, second: np.ndarray, way: int) -> np.ndarray:
    """`time` [s] carried on from each known one over the unknown that follow, in the sense `way` of time."""
    found = time.copy()
    recent: list[float] = []
    for i, (known, own) in enumerate(zip(time.tolist(), second.tolist(), strict=True)):
        if known == known:
            recent = [known]
        elif recent and own == own:
            now = float(np.median(recent))
            found[i] = now + way * float(_late(way * (own - now)))
            recent = [*recent[1 - RECENT :], found[i]]
    return found
