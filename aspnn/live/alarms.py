"""What the officer of the watch must be told: pure functions of what intake, estimator and forecast say of themselves, at a time.

Severities as on a bridge: an alarm needs action now, a warning soon, a caution attention. Times are those of the rows [s, UNIX];
the last sentences of a sensor are late by the latency at most, so a sensor counts as silent after LOST periods that are longer.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

from aspnn.live.estimator import EstimatorState
from aspnn.live.heard import IntakeState

STALE, LOST = 3.0, 10.0  # s without a position (or a heading) after which it is stale, and lost
SILENT = 5.0  # s without any good sentence on a channel
JUMPED = 60.0  # s for which a jump of a clock is told
# Mean NIS over its expectation, of half a minute, beyond which a sensor does not fit the filter. Of 30 independent values (one a
# second at the least) a fitting sensor exceeds 2.73 with a chance of 1e-6 (chi-square of 30 degrees of freedom).
DOUBTFUL = 3.0
# Share of damaged (or late) sentences of the last minutes beyond which a channel is told of, and how many it must have sent: on a sound line
# less than one in a thousand is.
BAD_SHARE, FEW = 0.05, 50
# s: of the starts of a ship that fits one in a hundred is said not to; after so long it is judged by other predictions than at first.
LASTING = 180.0


class Severity(StrEnum):
    """How soon somebody must act."""

    alarm = "alarm"
    warning = "warning"
    caution = "caution"


RANK = {severity: rank for rank, severity in enumerate(Severity)}


@dataclass(frozen=True)
class Alarm:
    """`code` is what programs go by, `text` what people read, `since` when it began [s, UNIX, of the rows]."""

    code: str
    severity: Severity
    text: str
    since: float


@dataclass(frozen=True)
class ForecastState:
    """What the forecast says of itself: outside what its model was trained for, whether it fits the ship (None: not known yet), and how
    many standard deviations it was off of late and may be; since when each [s, UNIX].
    """

    outside: bool = False
    fits: bool | None = None
    misfit: float = math.nan
    limit: float = math.nan
    outside_since: float = math.nan
    misfit_since: float = math.nan


@dataclass(frozen=True)
class Failure:
    """Something around the predictor that does not work (yet): the disk of the record, a socket of the output, a checkpoint."""

    what: str
    reason: str
    since: float
    severity: Severity = Severity.warning


def of_intake(state: IntakeState, antennas: Sequence[str], channels: Sequence[str], now: float) -> list[Alarm]:
    """Alarms of the sensors: position and heading stale or lost, silent channels, receivers that disagree, clocks, bad sentences."""
    found = []
    if not math.isnan(state.began):
        fixes = {a: state.told.get(f"{a}_latitude_deg", state.began) for a in antennas}
        found += _age("gnss", "position", max(fixes.values()), now)
        if now - max(fixes.values()) <= STALE:  # else all are silent, which has been said
            for antenna, last in fixes.items():
                if now - last > LOST:
                    text = f"antenna {antenna}: no position for {now - last:.0f} s"
                    found.append(Alarm(f"gnss_silent_{antenna}", Severity.warning, text, last + LOST))
        found += _age("heading", "heading", state.told.get("heading_deg", state.began), now)
    for channel in channels:
        if channel not in state.heard:
            text = f"channel {channel}: {_unheard(state.counts.get(channel, {}))}"
            found.append(Alarm(f"silent_{channel}", Severity.warning, text, _or(state.began, now)))
        elif now - (last := state.heard[channel]) > SILENT:
            text = f"channel {channel}: nothing heard for {now - last:.0f} s"
            found.append(Alarm(f"silent_{channel}", Severity.warning, text, last + SILENT))
    for key, (since, text) in state.disagree.items():
        found.append(Alarm(f"disagree_{key.replace(' ', '_')}", Severity.alarm, text, since))
    if state.jumped is not None and now - state.jumped.time <= JUMPED:
        found.append(Alarm("clock_jump", Severity.warning, state.jumped.text, state.jumped.time))
    for channel, (total, bad, late) in state.of_late.items():
        if total >= FEW and late > BAD_SHARE * total:
            text = f"channel {channel}: {late} of the {total} sentences of the last minutes came too late to be used; raise latency_s"
            found.append(Alarm(f"late_{channel}", Severity.caution, text, now))
        if total >= FEW and bad > BAD_SHARE * total:
            text = f"channel {channel}: {bad} of the {total} sentences of the last minutes are damaged; check its line"
            found.append(Alarm(f"damaged_{channel}", Severity.caution, text, now))
    unheard = [antenna for antenna in antennas if f"{antenna}_latitude_deg" not in state.told]
    if unheard and state.strangers:
        others = ", ".join(state.strangers[:5])
        text = f"antenna {unheard[0]}: no position, but positions of {others}: check antennas.{unheard[0]}.source"
        found.append(Alarm("antenna_source", Severity.warning, text, _or(state.began, now)))
    return found


def of_estimator(state: EstimatorState, now: float) -> list[Alarm]:
    """Alarms of the filters: not begun, fallen behind, coasting, a sensor that does not fit what the others tell."""
    if state.refused:
        return [Alarm("filter_refused", Severity.alarm, state.refused, now)]
    if not state.last:
        return [Alarm("filter_waiting", Severity.warning, "no position and heading yet: there is no prediction", now)]
    found = []
    if now - state.time > STALE:
        found.append(
            Alarm(
                "filter_behind",
                Severity.alarm,
                f"own ship was last known {now - state.time:.0f} s ago",
                state.time + STALE,
            )
        )
    if state.coasting_since is not None:
        off = math.hypot(state.last["north_m_sd"], state.last["east_m_sd"])
        text = f"dead reckoning for {state.time - state.coasting_since:.0f} s, own ship is known to {2 * off:.0f} m"
        found.append(Alarm("coasting", Severity.warning, text, state.coasting_since))
    for sensor, ratio in state.inconsistency.items():
        if ratio > DOUBTFUL:
            text = f"{sensor.replace('_', ' ')} does not fit the filter: its innovations are {math.sqrt(ratio):.1f} times what they should be"
            found.append(Alarm(f"inconsistent_{sensor}", Severity.warning, text, state.time))
    return found


def of_forecast(state: ForecastState, now: float) -> list[Alarm]:
    """Alarms of the model: outside what it was trained for, and no longer the ship that it knew."""
    found = []
    if state.outside:
        text = "the model was not trained for this (speed, rates, orders or wind): regions are doubled"
        found.append(Alarm("out_of_domain", Severity.caution, text, _or(state.outside_since, now)))
    if state.fits is False:
        text = f"the ship does not fit the model: predictions were {state.misfit:.1f} standard deviations off, {state.limit:.1f} is the limit"
        since = _or(state.misfit_since, now)
        found.append(Alarm("misfit", Severity.warning if now - since > LASTING else Severity.caution, text, since))
    return found


def of_failures(failures: Sequence[Failure]) -> list[Alarm]:
    """Alarms of what does not work around the predictor."""
    return [Alarm(f"failed_{f.what}", f.severity, f"{f.what}: {f.reason}", f.since) for f in failures]


def in_order(alarms: Sequence[Alarm], before: Sequence[Alarm] = ()) -> list[Alarm]:
    """Alarms by severity, then the newest first; one that stood `before` keeps its beginning, one of each code."""
    since = {a.code: a.since for a in before}
    kept = {
        a.code: Alarm(a.code, a.severity, a.text, min(a.since, since.get(a.code, a.since))) for a in reversed(alarms)
    }
    return sorted(kept.values(), key=lambda a: (RANK[a.severity], -a.since, a.code))


def _unheard(counts: Mapping[str, int]) -> str:
    """Why nothing is heard of a channel: nothing comes, or nothing that can be read, as of a wrong port or baud rate."""
    lines = counts.get("lines", 0)
    if not lines:
        return "nothing heard yet"
    faults = {fault: count for fault, count in counts.items() if fault not in ("lines", "sentences", "good")}
    most = max(faults, key=lambda fault: faults[fault], default="not to be read")
    return f"{lines} lines came, none of use (most are {most.replace('_', ' ')}); check its port, and the speed of a serial line"


def _age(code: str, what: str, last: float, now: float) -> list[Alarm]:
    age = now - last
    if age > LOST:
        return [Alarm(f"{code}_lost", Severity.alarm, f"{what} lost: none for {age:.0f} s", last + LOST)]
    if age > STALE:
        return [Alarm(f"{code}_stale", Severity.warning, f"{what} is {age:.0f} s old", last + STALE)]
    return []


def _or(since: float, now: float) -> float:
    return now if math.isnan(since) else since
