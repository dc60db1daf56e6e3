"""What goes wrong is told: failures of the loop as an alarm and once in the log, and a line in the log for each alarm."""

import logging
import math
import traceback
from collections.abc import Mapping
from typing import Any

from aspnn.live.alarms import Failure
from aspnn.live.core import Core

HOLD = 60.0  # s for which a failure of the loop is told after it last happened
STOOD = 1.0  # s that an alarm stands before it is logged
GONE = 5.0  # s after which an alarm that comes back is a new one
AGAIN = 60.0  # s before an alarm that comes and goes is logged again

log = logging.getLogger("aspnn.live")


class Troubles:
    """What went wrong in the loop itself: each kind is logged once with its traceback; the last one is an alarm for HOLD seconds."""

    def __init__(self, failures: dict[str, Failure]) -> None:
        self.count = 0
        self._failures, self._seen, self._last = failures, set[tuple[str, str, str]](), 0.0

    def happened(self, what: str, error: Exception, now: float) -> None:
        """`error` was raised at `now` [s, of the clock of receipt] while `what` was done."""
        self.count, self._last = self.count + 1, now
        where = traceback.extract_tb(error.__traceback__)[-1:]
        kind = (what, type(error).__name__, f"{where[0].filename}:{where[0].lineno}" if where else "")
        text = f"{what}: {type(error).__name__}: {' '.join(str(error).split())[:200]}"
        if kind not in self._seen:
            self._seen.add(kind)
            log.error("%s (the loop goes on; told once)", text, exc_info=error)
        since = self._failures["loop"].since if "loop" in self._failures else now
        self._failures["loop"] = Failure("loop", text, since)

    def settle(self, now: float) -> None:
        """Nothing has happened for long enough: the alarm is over."""
        if "loop" in self._failures and abs(now - self._last) > HOLD:
            del self._failures["loop"]


def once_more(message: Mapping[str, Any], core: Core) -> dict[str, Any]:
    """The last situation, with the alarm that there is no newer one."""
    failure = core.failures["loop"]
    text = f"not up to date: {failure.reason}"
    alarm = {"code": "failed_loop", "severity": "alarm", "text": text, "since": failure.since}
    others = [a for a in message["alarms"] if a["code"] != "failed_loop"]
    core.sequence = max(core.sequence, message["sequence"]) + 1
    return {**message, "alarms": [alarm, *others], "sequence": core.sequence}


def log_alarms(alarms: list[dict[str, Any]], told: dict[str, list[float]], moment: float) -> None:
    """A line for each alarm that has stood for STOOD seconds; one that comes and goes is logged at most once in AGAIN seconds.

    `told` holds by code when it was first seen, last seen, and last logged.
    """
    for alarm in alarms:
        seen = told.setdefault(alarm["code"], [moment, moment, -math.inf])
        if moment - seen[1] > GONE:
            seen[0] = moment
        seen[1] = moment
        if moment - seen[0] >= STOOD and moment - seen[2] >= AGAIN and seen[2] < seen[0]:
            seen[2] = moment
            log.warning("%s %s: %s", alarm["severity"], alarm["code"], alarm["text"])
    for code in [code for code, seen in told.items() if moment - seen[1] > AGAIN]:
        del told[code]
