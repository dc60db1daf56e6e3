"""Other ships: AIS reports and shared predictions become targets, each with its hull, its motion, and how sure that is.

A target of AIS moves on as it told: speed, course and rate of turn kept, the rate-of-turn arc. What a report does not tell comes from
the course filter over her positions. Where she will be grows unsure as `growth` says; all of that is assumed, nobody tells it.
"""

import math
from collections import Counter, deque
from dataclasses import dataclass, field, replace

from aspnn.angles import wrap
from aspnn.estimation.course import CourseModel, CourseTracker
from aspnn.frames import Zone, convergence, to_body, to_grid, to_north_east
from aspnn.live.ahead import ANY, Kind, Target
from aspnn.live.share import Prediction
from aspnn.logs.ais_clock import MINUTE
from aspnn.logs.ais_messages import COARSE, Clock, Report, Static, is_ship
from aspnn.logs.ais_vessel import ANTENNA, HEADING, TENTH, YAW_RATE, announced
from aspnn.logs.ais_write import INTERVALS
from aspnn.logs.readings import KNOT
from aspnn.schema import InputError
from aspnn.vessel import Vessel

MOST = 1000  # targets kept
LOST = 5  # reporting intervals without a report after which a target is lost (assumed)
SLOW_INTERVAL, SLOW_A, SLOW_B = (
    180.0,
    3 * KNOT,
    2 * KNOT,
)  # s, m/s: below, class A at anchor and class B report every 3 minutes
INTERVAL_B, INTERVAL_SHARED = 30.0, 2.0  # s (class B: recalled from ITU-R M.1371)
EARLY = 5.0  # s: so far may the second of a report be ahead of the clock of whoever received it
SLACK, MARGIN = 300.0, 5.0  # m, m/s: a fix that far beyond what speed allows is not believed,
AGAIN = 3  # until so many in a row say the same
RESTING = 0.5  # m/s: below, a course tells no heading
# Assumed standard deviations: of a fix with the flag of 10 m or better (95 %), and without; of the velocity along and across; of a
# heading taken from the course (drift).
ACCURATE, PLAIN = 10 / 2.45, 20 / 2.45  # m
VELOCITY, DRIFT = 0.2, math.radians(4.0)  # m/s, rad


def reported_time(second: float, received: float) -> float:
    """When a report was true [s, UNIX], by the UTC `second` of its fix and the time of receipt, at most EARLY after that."""
    if not math.isfinite(second):
        return received
    late = (received - second + EARLY) % MINUTE - EARLY
    return received - late


def interval(report: Report, speed: float) -> float:
    """How long a ship waits between two position reports [s] at `speed` [m/s] (ITU-R M.1371 as far as one report tells)."""
    if report.kind == COARSE:
        return SLOW_INTERVAL
    if report.kind in (18, 19):
        return SLOW_INTERVAL if speed < SLOW_B else INTERVAL_B
    return SLOW_INTERVAL if speed < SLOW_A else next(steady for limit, steady, _ in INTERVALS if speed <= limit * KNOT)


@dataclass
class _Track:
    """What is known of one MMSI."""

    statics: deque[Static] = field(default_factory=lambda: deque(maxlen=8))
    kinds: set[int] = field(default_factory=set)
    target: Target | None = None
    vessel: Vessel | None = None
    tracker: CourseTracker | None = None
    strays: list[tuple[float, float, float]] = field(default_factory=list)  # time, north, east of fixes not believed
    heard: float = -math.inf


class Targets:
    """All targets on the grid of `zone`; own ship's MMSI is none. At most MOST are kept. Driven by the caller's clock."""

    def __init__(self, zone: Zone, own: int | None = None):
        self.zone, self.own = zone, own
        self.counts: Counter[str] = Counter()
        self._ais: dict[int, _Track] = {}
        self._shared: dict[str, Target] = {}

    def is_own(self, mmsi: int) -> None:
        """Own ship has this MMSI, as her transponder says (VDO): what others relay of it is no target."""
        self.own = mmsi
        self._ais.pop(mmsi, None)

    def hear(self, said: "Report | Static | Clock | int", received: float) -> None:
        """Take in what an AIS message says, received at `received` [s, UNIX]. Never raises for what it says."""
        if not isinstance(said, Report | Static) or said.mmsi == self.own or not is_ship(said.mmsi):
            return
        static = said if isinstance(said, Static) else said.static
        track = self._ais.get(said.mmsi) or _Track()
        track.heard = received
        if static is not None and static not in track.statics:
            track.statics.append(static)
            track.vessel = None
        if isinstance(said, Report):
            self._report(track, said, reported_time(said.second, received))
        self._ais[said.mmsi] = track
        if len(self._ais) > MOST:
            self.counts["crowded_out"] += 1
            del self._ais[min(self._ais, key=lambda mmsi: self._ais[mmsi].heard)]

    def hear_shared(self, said: Prediction, received: float) -> None:
        """Take in a prediction that another ship shares (`share.Inbox` has checked it). One outside the zone is counted, not used."""
        if said.mmsi is not None and said.mmsi == self.own:
            return
        try:
            path = said.in_grid(self.zone)
        except InputError:
            self.counts["shared_outside_zone"] += 1
            return
        assert isinstance(path.convergence, float)
        static = Static(said.mmsi or 0, 5, said.name, None, 0.0)
        vessel = _hull(said.mmsi or 0, [static], {1}, said.length, said.beam)
        model = CourseModel.of(vessel)
        self._shared[said.instance] = Target(
            id=str(said.mmsi) if said.mmsi is not None else said.instance,
            name=said.name,
            kind=Kind.shared,
            time=said.time,
            north=float(path.north[0]),
            east=float(path.east[0]),
            heading=float(path.heading[0]),
            convergence=path.convergence,
            surge=said.surge,
            sway=said.sway,
            yaw_rate=math.radians(said.rot) / 60,
            heading_told=float(path.heading[0]),
            rate_told=math.radians(said.rot) / 60,
            derived=False,
            vessel=vessel,
            sized=True,
            interval=INTERVAL_SHARED,
            position_sd=ACCURATE,
            velocity_sd=VELOCITY,
            heading_sd=HEADING,
            rate_sd=YAW_RATE,
            speed_density=model.speed_density,
            turn_density=model.turn_density,
            path=path,
        )

    def present(self, now: float) -> list[Target]:
        """The targets that are not lost at `now` [s, UNIX]. A ship that shares her prediction is not also there by AIS."""
        sharing = [t for t in self._shared.values() if now - t.time <= LOST * t.interval]
        ids = {target.id for target in sharing}
        heard = [track.target for track in self._ais.values() if track.target is not None]
        return sharing + [t for t in heard if t.id not in ids and now - t.time <= LOST * t.interval]

    def forget(self, now: float) -> list[Target]:
        """Drop the targets that are lost at `now` [s, UNIX] and return them, so that somebody can be told."""
        shared = {key: t for key, t in self._shared.items() if now - t.time > LOST * t.interval}
        gone = list(shared.values())
        for key in shared:
            del self._shared[key]
        for mmsi, track in list(self._ais.items()):
            if track.target is not None and now - track.target.time > LOST * track.target.interval:
                gone.append(track.target)
                del self._ais[mmsi]
            elif track.target is None and now - track.heard > LOST * SLOW_INTERVAL:
                del self._ais[mmsi]
        return gone

    def _report(self, track: _Track, said: Report, time: float) -> None:
        last = track.target
        if not said.measured or not math.isfinite(said.latitude_deg + said.longitude_deg):
            self.counts["without_position"] += 1
            return
        if last is not None and time <= last.time:
            self.counts["late_or_repeated"] += 1
            return
        latitude, longitude = math.radians(said.latitude_deg), math.radians(said.longitude_deg)
        north, east = (float(x) for x in to_grid(latitude, longitude, self.zone))
        gamma = float(convergence(latitude, longitude, self.zone))
        if not math.isfinite(north + east + gamma):
            self.counts["outside_zone"] += 1
            return
        track.kinds.add(said.kind)
        if track.vessel is None:
            track.vessel = _vessel(said.mmsi, list(track.statics), track.kinds)
        if last is not None and self._jumps(track, last, said, time, north, east):
            self.counts["jumps"] += 1
            return
        position_sd = ACCURATE if said.accurate else PLAIN
        position_sd = math.hypot(position_sd, TENTH) if said.kind == COARSE else position_sd
        if track.tracker is None:
            track.tracker = CourseTracker(CourseModel.of(track.vessel), position_sd)
        track.tracker.step(time, north, east)
        track.target = _target(track, said, time, north, east, gamma, position_sd)

    def _jumps(self, track: _Track, last: Target, said: Report, time: float, north: float, east: float) -> bool:
        """Whether no ship gets to a fix from her last one; AGAIN fixes that agree with each other begin the track anew there."""

        def reached(t: float, n: float, e: float, speed: float) -> bool:
            return math.hypot(north - n, east - e) <= SLACK + (1.5 * speed + MARGIN) * (time - t)

        told = said.speed_m_s if math.isfinite(said.speed_m_s) else 0.0
        if reached(last.time, last.north, last.east, max(told, last.speed)):
            track.strays.clear()
            return False
        if track.strays and not reached(*track.strays[-1], told):
            track.strays.clear()
        track.strays.append((time, north, east))
        if len(track.strays) < AGAIN:
            return True
        track.strays.clear()
        track.tracker = None
        return False


def _vessel(mmsi: int, statics: list[Static], kinds: set[int]) -> Vessel:
    """The vessel that a ship announces; where what she announces is none, the one assumed."""
    try:
        return announced(mmsi, statics, kinds, 1.0)[0]
    except InputError:
        return announced(mmsi, [s._replace(size=None, draught=0.0) for s in statics], kinds, 1.0)[0]


def _hull(mmsi: int, statics: list[Static], kinds: set[int], length: float, beam: float) -> Vessel:
    return replace(_vessel(mmsi, statics, kinds), length=length, beam=beam)


def _target(track: _Track, said: Report, time: float, north: float, east: float, gamma: float, sd: float) -> Target:
    """The target of a report with its antenna at `north`, `east` [m], fixed with `sd` [m]."""
    vessel, tracker, last = track.vessel, track.tracker, track.target
    assert vessel is not None and tracker is not None
    model = CourseModel.of(vessel)
    known = bool(tracker.ready[0])
    speed, course, derived, velocity_sd = said.speed_m_s, math.radians(said.course_deg) - gamma, False, VELOCITY
    if not math.isfinite(speed) or (not math.isfinite(course) and speed >= RESTING):
        derived = True
        if known:
            speed, course = float(tracker.speed[0]), float(tracker.course[0])
            velocity_sd = math.hypot(VELOCITY, float(tracker.sd[0, 2]))
        else:
            speed, velocity_sd = 0.0, vessel.service_speed
    if not math.isfinite(course):
        course = 0.0 if last is None else last.heading
        velocity_sd = math.hypot(velocity_sd, speed)
    heading_told = math.radians(said.heading_deg) - gamma
    if math.isfinite(heading_told):
        heading, heading_sd = heading_told, HEADING
    elif speed >= RESTING:
        heading, heading_sd = course, min(math.hypot(DRIFT, velocity_sd / speed), ANY)
    elif last is not None:
        heading, heading_sd = last.heading, ANY
    else:
        heading, heading_sd = course, ANY
    rate_told = math.radians(said.yaw_rate_deg_s)
    rate, rate_sd = rate_told, YAW_RATE
    if not math.isfinite(rate):
        # Positions tell a turn only where it stands out of what the filter does not know.
        rate = float(tracker.course_rate[0]) if known else 0.0
        rate_sd = float(tracker.sd[0, 4]) if known else math.sqrt(model.turn_density / (2 * model.alpha_turn))
        if abs(rate) < 2 * rate_sd:
            rate = 0.0
    x, y = vessel.stations[ANTENNA]
    lever = to_north_east(x, y, heading)
    u, v = to_body(speed * math.cos(course), speed * math.sin(course), heading)
    return Target(
        id=f"{said.mmsi:09d}",
        name=next((s.name for s in reversed(track.statics) if s.name), ""),
        kind=Kind.ais,
        time=time,
        north=north - float(lever[0]),
        east=east - float(lever[1]),
        heading=float(wrap(heading)),
        convergence=gamma,
        surge=float(u) + rate * y,
        sway=float(v) - rate * x,
        yaw_rate=rate,
        heading_told=heading_told,
        rate_told=rate_told,
        derived=derived,
        vessel=vessel,
        sized=vessel.sources["dimensions.length_overall_m"] != "assumed",
        interval=interval(said, speed),
        position_sd=math.hypot(sd, math.hypot(x, y) * min(heading_sd, 1.0)),
        velocity_sd=velocity_sd,
        heading_sd=heading_sd,
        rate_sd=rate_sd,
        speed_density=model.speed_density,
        turn_density=model.turn_density,
    )
