"""The bridge's work without clocks, sockets or threads: lines and an instant in, the situation out. `serve` drives it, and tests do.

One `take` after another brings rows through the filters, as often as there are any; `look` predicts and makes the message. What-if
plans may be asked from another thread: they read a snapshot that is replaced as a whole. Depends on all of live but serve and server.
"""

import math
import secrets
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any, NamedTuple

from aspnn.live import alarms as told
from aspnn.live import lookout, share
from aspnn.live.alarms import Alarm, Failure, ForecastState, Severity
from aspnn.live.chart import Chart
from aspnn.live.config import Bridge
from aspnn.live.encounter import Danger, Limits, assess
from aspnn.live.entries import target_entries
from aspnn.live.estimator import LiveEstimator
from aspnn.live.forecast import HELD, Forecast, Forecaster
from aspnn.live.intake import Intake, Row
from aspnn.live.output import UdpOut, prediction_sentences, vbw
from aspnn.live.record import Recorder
from aspnn.live.situation import Picture, situation
from aspnn.live.targets import Target, Targets
from aspnn.live.whatif import Other, WhatIf, answer
from aspnn.logs.ais_messages import Report, Static, is_ship
from aspnn.motion import Path
from aspnn.prediction import Predictor
from aspnn.records import States
from aspnn.schema import InputError

if TYPE_CHECKING:  # a ship at sea needs no simulator, and starts sooner without
    from aspnn.live.bridge import SimulatedBridge

KEEP = 600.0  # s of states
TOO_OLD = 10.0  # s: a prediction from a state that is older is not shown
USED = 2.0  # s since its last position for which an antenna counts as used
OUT = 1.0  # s between what is sent to other systems
SAVE = 2.0  # s between saved states of the filters
# What is dear is reckoned anew once in AGAIN seconds, and at once under a new rudder order or new limits: the swept region, and (at
# other looks, where there are several in a second) how near the targets come.
AGAIN = 1.0  # s
PHASE = {"region": 0.0, "targets": 0.5}  # s
LOG_OLD = 10.0  # s for which the last speed through the water is shown
SAVED = "state.npz"
NO_FAULTS = ("lines", "sentences", "good", "out_of_order")


class _Seen(NamedTuple):
    """The targets as they were reckoned from `time` [s, UNIX]."""

    time: float
    found: list[Danger]
    entries: list[dict[str, Any]]
    others: list[Other]


class _Snapshot(NamedTuple):
    states: States
    epoch: float
    others: list[Other]


@dataclass
class Core:
    """All that one bridge keeps in mind. `simulated` takes the page's orders; without it there are none."""

    bridge: Bridge
    predictor: Predictor | None = None
    chart: Chart | None = None
    recorder: Recorder | None = None
    out: UdpOut | None = None
    simulated: "SimulatedBridge | None" = None
    saved: FilePath | None = None  # where the filters' state is kept
    instance: str = field(default_factory=lambda: secrets.token_hex(8))
    failures: dict[str, Failure] = field(default_factory=dict)
    log: list[str] = field(default_factory=list)  # lines for people, taken away by the caller
    clients: int = 0

    def __post_init__(self) -> None:
        config, vessel = self.bridge.config, self.bridge.vessel
        self.intake = Intake(self.bridge)
        self.estimator = LiveEstimator(vessel, self.bridge.zone, KEEP, tuple(config.antennas))
        if self.saved is not None and self.saved.exists():
            self._restore(self.saved)
        self.forecaster = Forecaster(self.predictor, vessel, chart=self.chart)
        self.targets = Targets(self.bridge.zone, config.ship.mmsi)
        self.limits = Limits(config.limits.cpa_m, config.limits.tcpa_s, config.limits.guard_m)
        self.inbox = share.Inbox(self.instance)
        self.forecast: Forecast | None = None
        self.alarms: list[Alarm] = []
        self.sequence = 0
        self.shared_out: bytes | None = None  # the newest message for other ships, taken away by the caller
        self._snapshot: _Snapshot | None = None
        self._seen: _Seen | None = None
        self._lost: dict[str, lookout.Lost] = {}
        self._reckoned: dict[str, tuple[Any, ...]] = {}
        self._order, self._orders = math.nan, 0
        self._through = math.nan, -math.inf  # speed through the water [m/s] and when [s, UNIX]
        self._fresh = 0
        self._doubts: dict[str, float] = {}
        self._sent = self._kept = -math.inf
        self._shared = 0

    def _restore(self, path: FilePath) -> None:
        try:
            found = LiveEstimator.restore(path)
        except InputError as error:
            self.log.append(str(error))
            return
        same = found.vessel == self.estimator.vessel and found.zone == self.estimator.zone
        if same and found.antennas == self.estimator.antennas:
            self.estimator = found
            self.log.append(f"{path}: the filters go on from where they were")
        else:
            self.log.append(f"{path}: is of another ship, zone or antennas; the filters begin anew")

    def adopt(self, predictor: Predictor) -> None:
        """Predict by `predictor` from now on; what was predicted before is not judged any more."""
        self.predictor = predictor
        self.forecaster = Forecaster(predictor, self.bridge.vessel, chart=self.chart)

    def feed(self, text: str, received: float, channel: str) -> None:
        """Lines as they came."""
        self.intake.feed(text, received, channel)

    def hear_shared(self, data: bytes, received: float) -> bool:
        """A message of another instance; whether it is taken."""
        said = self.inbox.take(data, received)
        if said is not None:
            self.targets.hear_shared(said, received)
        return said is not None

    def take(self, now: float) -> int:
        """Bring the rows that are ready at `now` [s, UNIX, clock of receipt] through the filters; how many states there are more."""
        rows = self.intake.rows(now)
        while self.intake.targets_in:
            ais = self.intake.targets_in.popleft()
            if not ais.own:
                self.targets.hear(ais.said, ais.time)
            elif isinstance(ais.said, Report | Static) and is_ship(ais.said.mmsi):
                self.targets.is_own(ais.said.mmsi)
        return self.push(rows) if rows else 0

    def push(self, rows: Sequence[Row]) -> int:
        """Bring rows through the filters, and into the record; how many states there are more."""
        self._logged(rows)
        if self.recorder is not None:
            self.recorder.rows(rows)
        count = self.estimator.push(rows)
        self._fresh += count
        return count

    def _logged(self, rows: Sequence[Row]) -> None:
        """Keep the last speed through the water."""
        for row in rows:
            if "speed_through_water_m_s" in row.values:
                self._through = row.values["speed_through_water_m_s"], row.time

    def look(self, now: float) -> dict[str, Any]:
        """The situation at `now` [s, UNIX, clock of receipt]: predictions, targets, alarms. Sends, shares and records what is due."""
        clock, states, epoch = self.intake.time(now), self.estimator.states, self.estimator.began
        self._lose(clock)
        if states is not None:
            states = states.read()
            self._predict(states, epoch, clock)
            self._encounters(states, epoch)
        else:
            self.forecast = self._snapshot = self._seen = None
        self.alarms = told.in_order(self._alarms(epoch, clock), self.alarms)
        self.sequence += 1
        message = situation(self._picture(states, epoch, clock))
        if abs(now - self._sent) >= OUT:
            self._sent = now
            self._send(states, epoch)
        self._keep(now)
        return message

    def _predict(self, states: States, epoch: float, clock: float) -> None:
        fresh, self._fresh = self._fresh, 0
        if fresh:
            order, start = float(states["rudder_order_rad"][-1]), epoch + float(states["time_s"][-1])
            if not abs(order - self._order) <= HELD:
                self._order, self._orders = order, self._orders + 1
            before = None if self._due("region", start) else self.forecast
            self.forecast = self.forecaster.predict(states, before=before)
            self.forecaster.keep(self.forecast)
            ended = self.forecaster.verify(states)
            if self.recorder is not None:
                self.recorder.states(states.table.iloc[-fresh:], epoch)
                self.recorder.forecast(self.forecast, self.forecaster.horizons, order, epoch)
                self.recorder.ended(ended, epoch)
        if clock - (epoch + float(states["time_s"][-1])) > TOO_OLD:
            self.forecast = None

    def _due(self, what: str, start: float) -> bool:
        """Whether something is to be reckoned anew from `start` [s, UNIX]; then it counts as done."""
        key = math.floor((start + PHASE[what]) / AGAIN), self._orders, self.limits if what == "targets" else None
        before, self._reckoned[what] = self._reckoned.get(what), key
        return key != before

    def _encounters(self, states: States, epoch: float) -> None:
        forecast = self.forecast
        if forecast is None:
            self._seen, self._reckoned = None, {}
        elif self._due("targets", epoch + forecast.start) or self._seen is None:
            own, start = forecast.path or forecast.arc, epoch + forecast.start
            present = self.targets.present(start)
            found, paths = assess(own, self.forecaster.outline, present, start, self.limits)
            entries = target_entries(found, paths, start, self.bridge.zone)
            self._seen = _Seen(start, found, entries, _others(present, paths, start))
        self._snapshot = _Snapshot(states, epoch, [] if self._seen is None else self._seen.others)

    def _lose(self, clock: float) -> None:
        """Forget the targets that are lost, and keep in mind those that were dangerous."""
        dangerous = {d.target.id for d in self._seen.found if d.dangerous} if self._seen is not None else set()
        for target in self.targets.forget(clock):
            if target.id in dangerous:
                self._lost[target.id] = lookout.Lost(target.id, target.name, clock)
        if self._lost:
            there = {target.id for target in self.targets.present(clock)}
            lost = self._lost.items()
            self._lost = {id: one for id, one in lost if id not in there and 0 <= clock - one.since <= lookout.TOLD}

    def _alarms(self, epoch: float, clock: float) -> list[Alarm]:
        config, forecast = self.bridge.config, self.forecast
        found = told.of_intake(
            self.intake.state(), list(config.antennas), [source.name for source in config.sources], clock
        )
        found += told.of_estimator(self.estimator.state(), clock)
        found += told.of_failures(self._failed(clock))
        found += lookout.of_lost(self._lost.values(), clock)
        if self._seen is not None:
            found += lookout.of_dangers(self._seen.found, clock)
        if forecast is not None:
            found += lookout.of_touches(forecast.touches, clock)
        if forecast is None:
            return found
        if forecast.refused:
            since = self._since("refused", True, clock)
            found.append(Alarm("no_prediction", Severity.warning, f"the arc alone is shown: {forecast.refused}", since))
            return found
        self._since("refused", False, clock)
        spread = None if forecast.path is None else forecast.path.spread
        state = ForecastState(
            forecast.outside,
            forecast.fits,
            math.nan if spread is None else float(spread.misfit),
            math.nan if spread is None else float(spread.limit),
            self._since("outside", forecast.outside, clock),
            self._since("misfit", forecast.fits is False, clock),
        )
        return found + told.of_forecast(state, clock)

    def _since(self, what: str, there: bool, clock: float) -> float:
        """Since when something is there; NaN when it is not."""
        if not there:
            self._doubts.pop(what, None)
            return math.nan
        return self._doubts.setdefault(what, clock)

    def _failed(self, clock: float) -> list[Failure]:
        """What does not work around the predictor: told by others, and by record and output themselves."""
        for what, reason in (
            ("record", self.recorder.error if self.recorder else ""),
            ("output", self.out.error if self.out else ""),
        ):
            if not reason:
                self.failures.pop(what, None)
            elif what not in self.failures:
                self.failures[what] = Failure(what, reason, clock)
                self.log.append(f"{what}: {reason}")
        return list(self.failures.values())

    def _picture(self, states: States | None, epoch: float, clock: float) -> Picture:
        state = self.intake.state()
        entries = [] if self._seen is None else self._seen.entries
        through, when = self._through
        used = [a for a in self.bridge.config.antennas if clock - state.told.get(f"{a}_latitude_deg", -math.inf) < USED]
        rejected: dict[str, int] = {}
        for counts in state.counts.values():
            for fault, count in counts.items():
                if fault not in NO_FAULTS:
                    rejected[fault] = rejected.get(fault, 0) + count
        late = rejected.pop("late", 0)
        taken = sum(counts.get("sentences", 0) for counts in state.counts.values())
        return Picture(
            vessel=self.bridge.vessel,
            zone=self.bridge.zone,
            epoch=epoch,
            states=states,
            forecast=self.forecast,
            scores=self.forecaster.scores(),
            horizon=self.forecaster.horizon,
            targets=entries,
            targets_time=None if self._seen is None else self._seen.time,
            limits={"cpa": self.limits.cpa, "tcpa": self.limits.tcpa},
            alarms=[a.__dict__ | {"severity": a.severity.value} for a in self.alarms],
            counts={
                "sentences": taken,
                "rejected": rejected,
                "late": late,
                "targets": len(entries),
                "clients": self.clients,
            },
            model=None if self.predictor is None else self.predictor.name,
            antennas=used,
            mmsi=self.targets.own,
            stw=through if 0 <= clock - when <= LOG_OLD else None,
            simulated=None if self.simulated is None else self.simulated.orders,
            chart=None if self.chart is None else self.chart.tag,
            sequence=self.sequence,
        )

    def _send(self, states: States | None, epoch: float) -> None:
        """VBW and $PASPN to other systems; the prediction for other ships into `shared_out`."""
        forecast, config = self.forecast, self.bridge.config
        if states is None or forecast is None:
            return
        if self.out is not None:
            self.out.send([vbw(states), *prediction_sentences(forecast, self.bridge.zone, epoch)])
        if config.share is not None and forecast.path is not None:
            self._shared += 1
            vessel = self.bridge.vessel
            sender = share.Sender(self.instance, config.share.name, self.targets.own, vessel.length, vessel.beam)
            try:
                self.shared_out = share.encode(
                    sender, self._shared, epoch + forecast.start, forecast.path, self.bridge.zone
                )
                self.failures.pop("share", None)
            except InputError as error:
                self.failures.setdefault("share", Failure("share", str(error), epoch + forecast.start))

    def _keep(self, now: float) -> None:
        if self.recorder is not None:
            self.recorder.flush(now)
        if self.saved is not None and abs(now - self._kept) >= SAVE:
            self._kept = now
            self.save()

    def save(self) -> None:
        """Save the filters' state, if it is to be kept. A disk that fails is told, never raised."""
        if self.saved is None:
            return
        try:
            self.estimator.save(self.saved)
            self.failures.pop("state", None)
        except OSError as error:
            self.failures.setdefault(
                "state", Failure("state", f"{self.saved}: {error.strerror or error}", self.intake.time(self._kept))
            )

    def events(self) -> list[str]:
        """Lines for people of what happened since the last call."""
        for events in (self.intake.events, self.estimator.events):
            while events:
                self.log.append(events.popleft().text)
        lines, self.log[:] = list(self.log), []
        return lines

    def whatif(self, asked: WhatIf) -> dict[str, Any]:
        """The answer to a what-if request from the newest states. Raises InputError, one line."""
        snapshot = self._snapshot
        if snapshot is None:
            raise InputError("what if: there is no own ship yet; wait for position and heading")
        return answer(asked, self.forecaster, snapshot.states, snapshot.epoch, snapshot.others)

    def limit(self, cpa: float, tcpa: float) -> None:
        """Set from where on a target is dangerous. Raises InputError."""
        self.limits = replace(self.limits, cpa=cpa, tcpa=tcpa)

    def order(self, rudder: float | None, shaft: float | None) -> dict[str, Any] | None:
        """Order rudder [deg] and shaft [rev/s] of a simulated bridge; None where there is none. Raises InputError beyond the stops."""
        if self.simulated is None:
            return None
        self.simulated.order(None if rudder is None else math.radians(rudder), shaft)
        orders = self.simulated.orders
        return {"rudder": orders["rudder_order"], "shaft": orders["shaft_order"]}


def _others(targets: Sequence[Target], paths: Path, start: float) -> list[Other]:
    """The targets for what-if plans; `paths` (targets, steps) from `start` [s, UNIX] in the same order."""
    return [
        Other(target.id, target.name or None, paths[k], start, target.outline if target.sized else None)
        for k, target in enumerate(targets)
    ]
