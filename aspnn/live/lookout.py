"""What lies ahead that somebody must be told of: ground, other ships, and ships that are no longer heard. Pure, as live.alarms.

`grounding` (alarm) and `touching` (warning: a berth, a buoy, the contour of depth next deeper than the draught) are of the predicted
ship; `contact_ID` (alarm) where the predicted hulls touch, `danger_ID` (warning) where they come within the limits, `target_lost_ID`
(warning) for a minute after a dangerous target was heard no more.
"""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

from aspnn.live.alarms import Alarm, Severity
from aspnn.live.encounter import Danger
from aspnn.live.forecast import Touching

TOLD = 60.0  # s for which a lost target is told of
MOST = 5  # dangerous targets told of one by one; the list has them all
TOUCHING = 1e-3  # m: hulls as near as that touch
SOON = 0.5  # s: what is nearer than that is now


class Lost(NamedTuple):
    """A dangerous target that is no longer heard, since when [s, UNIX]."""

    id: str
    name: str
    since: float


def of_touches(touches: Sequence[Touching], now: float) -> list[Alarm]:
    """Alarms of what the predicted ship touches."""
    found = []
    for touch in touches:
        verb = "crosses" if "contour" in touch.what and not touch.aground else "touches"
        text = f"predicted ship {verb} {touch.what} in {touch.time:.0f} s"
        if touch.time < SOON:
            text = f"the ship {verb} {touch.what} now"
        code, severity = ("grounding", Severity.alarm) if touch.aground else ("touching", Severity.warning)
        found.append(Alarm(code, severity, text, now))
    return found


def of_dangers(dangers: Sequence[Danger], now: float) -> list[Alarm]:
    """Alarms of dangerous targets, in the order of `dangers`; each predicted contact, and of the others the first MOST."""
    found, more = [], 0
    for danger in (d for d in dangers if d.dangerous):
        target = danger.target
        who = target.name or target.id
        if danger.cpa < TOUCHING:
            text = (
                f"contact with {who} predicted in {danger.tcpa:.0f} s"
                if danger.tcpa >= SOON
                else f"contact with {who} now"
            )
            found.append(Alarm(f"contact_{target.id}", Severity.alarm, text, now))
        elif more < MOST:
            found.append(Alarm(f"danger_{target.id}", Severity.warning, _nears(danger, who), now))
            more += 1
        else:
            more += 1
    if more > MOST:
        text = f"{more - MOST} more targets within the limits: see the list"
        found.append(Alarm("danger_more", Severity.warning, text, now))
    return found


def _nears(danger: Danger, who: str) -> str:
    if danger.receding:
        return f"{who} is {danger.cpa:.0f} m off and goes away"
    # The straight lines may look beyond the horizon, where the hulls' least distance within it says less.
    if danger.dcpa < danger.cpa and danger.dtcpa > danger.tcpa:
        return f"{who} passes {danger.dcpa:.0f} m off in {_duration(danger.dtcpa)} (straight on)"
    return f"{who} comes within {danger.cpa:.0f} m in {_duration(danger.tcpa)}"


def of_lost(lost: Iterable[Lost], now: float) -> list[Alarm]:
    """Warnings of dangerous targets that are lost."""
    return [
        Alarm(
            f"target_lost_{one.id}",
            Severity.warning,
            f"dangerous target {one.name or one.id} lost: not heard any more for {now - one.since:.0f} s",
            one.since,
        )
        for one in lost
    ]


def _duration(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 120 else f"{seconds / 60:.0f} min"
