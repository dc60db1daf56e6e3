"""Manoeuvres that close a loop round the ship: routes followed by line of sight, and courses, steered by an autopilot.

`steering` says how; what it leaves out follows from the ship: Nomoto's constants of her own zigzag, distances and times in her lengths.
Depends on plan, steering and guidance.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from pydantic import AfterValidator, BaseModel, Field

from aspnn.frames import to_grid
from aspnn.guidance.autopilot import CourseAutopilot, ReferenceFilter
from aspnn.guidance.pilot import Loop, PathHelm
from aspnn.guidance.reference_model import ReferenceModel
from aspnn.guidance.route import Follower, Route
from aspnn.guidance.steered import CourseHelm, CourseLoop, Sampled
from aspnn.orders import Orders
from aspnn.schema import InputError
from aspnn.simulation.nomoto import turning_radius
from aspnn.simulation.plan import STRICT, Departure, Range, Series
from aspnn.simulation.steering import Steering, Tuned, law_of, navigation_of

SPARE = 1.5  # times the way at the fastest start or service speed that a random route is long


def _legs(pair: tuple[float, float]) -> tuple[float, float]:
    if pair[0] <= 0:
        raise ValueError(f"a leg of {pair[0]:g} m is none; its length must be above 0")
    return pair


def _turns(pair: tuple[float, float]) -> tuple[float, float]:
    if pair[0] < 0 or pair[1] > 150:
        raise ValueError(
            f"turns from {pair[0]:g} to {pair[1]:g} degrees, to either side; they must be within 0 and 150"
        )
    return pair


@dataclass
class Steersman:
    """The helm of a batch of voyages and, after the run, the notes on each of their logs."""

    helm: Callable[[float, np.ndarray], np.ndarray]
    told: Callable[[], list[dict[str, str]]]

    def __call__(self, time: float, state: np.ndarray) -> np.ndarray:
        """Orders (batch,) [rad]."""
        return self.helm(time, state)

    def notes(self) -> list[dict[str, str]]:
        """What to note on each voyage's log."""
        return self.told()


def _followed(
    routes: list[Route], steering: Steering, leaving: Departure, rngs: Sequence[np.random.Generator], listed: bool
) -> Steersman:
    """Steers ships along their routes, one each; those `listed` are to be finished, drawn ones have no end."""
    tuned = Tuned.of(steering, leaving)
    navigation = navigation_of(steering, leaving, rngs)

    def make(ships: int) -> Loop:
        law, rate = law_of(steering, tuned, leaving.speed, ships)
        reference = ReferenceFilter(tuned.low_pass, ships)
        pilot = CourseAutopilot(tuned.gains, tuned.K, tuned.T, tuned.limit, ships)
        return Loop(navigation(ships), Follower(routes, tuned.switch, ships), law, rate, reference, pilot)

    helm = PathHelm(make)
    make(len(routes))  # what is wrong with routes and settings is told before anything is simulated
    turning = turning_radius(leaving.ship, leaving.speed, tuned.limit) if listed else 0.0

    def told() -> list[dict[str, str]]:
        follower, pilot = helm.loop.follower, helm.loop.autopilot
        assert isinstance(follower, Follower)
        found = []
        for number, route in enumerate(routes):
            reached = int(follower.leg[number]) + int(follower.done[number])
            limits = _limits(pilot, number, tuned, route.sharp(tuned.switch, turning) if listed else None)
            found.append(
                {"waypoints": f"{reached} of {len(route.lengths)} reached" if listed else f"{reached} reached"} | limits
            )
        return found

    return Steersman(Sampled(helm, tuned.every), told)


def _limits(pilot: CourseAutopilot, number: int, tuned: Tuned, sharp: str | None = None) -> dict[str, str]:
    """Notes on how long a voyage's steering was at its limit; none where it never was."""
    whole, longest = float(pilot.saturated[number]), float(pilot.longest[number])
    notes = {"rudder_saturated": f"{whole:.0f} s, at most {longest:.0f} s without a break"} if whole else {}
    if longest > tuned.patience:
        held = f"rudder at {math.degrees(tuned.limit):.3g} degrees for {longest:.0f} s"
        notes["steering"] = f"the vessel cannot follow the reference: {held}{f'; {sharp}' if sharp else ''}"
    return notes


def _points(points: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
    try:
        Route(np.array(points))
    except InputError as error:
        raise ValueError(str(error)) from None
    return points


def _places(points: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
    for latitude, longitude in points:
        if not (-80 <= latitude <= 84 and -180 <= longitude <= 180):
            raise ValueError(f"[{latitude:g}, {longitude:g}] is no latitude and longitude in degrees")
    return points


class Waypoints(BaseModel):
    """A route through waypoints: `points_m` [north, east] of the grid from the start, or `points_deg` [latitude, longitude]."""

    model_config = STRICT
    kind: Literal["waypoints"]
    points_m: Annotated[tuple[tuple[float, float], ...], AfterValidator(_points)] | None = None
    points_deg: Annotated[tuple[tuple[float, float], ...], AfterValidator(_places)] | None = None
    steering: Steering = Steering()

    @property
    def rudder_deg(self) -> float:
        """The largest order [deg]."""
        return self.steering.rudder_deg

    def helm(self, rngs: Sequence[np.random.Generator], leaving: Departure) -> Steersman:
        """All voyages follow the same route."""
        if (self.points_m is None) == (self.points_deg is None):
            raise InputError("manoeuvre: give the waypoints as points_m or as points_deg, one of them")
        if self.points_deg is not None:
            latitude, longitude = np.radians(np.array(self.points_deg)).T
            route = Route(np.stack(to_grid(latitude, longitude, leaving.zone), axis=-1))
        else:
            route = Route(np.array(self.points_m) + np.array([leaving.north, leaving.east]))
        return _followed([route] * len(rngs), self.steering, leaving, rngs, listed=True)


class RandomRoute(BaseModel):
    """A route drawn anew for each voyage: the first leg ahead, each turn within `turn_deg` to either side, legs within `leg_m`."""

    model_config = STRICT
    kind: Literal["random-route"]
    leg_m: Annotated[Range, AfterValidator(_legs)]
    turn_deg: Annotated[Range, AfterValidator(_turns)] = (15.0, 90.0)
    steering: Steering = Steering()

    @property
    def rudder_deg(self) -> float:
        """The largest order [deg]."""
        return self.steering.rudder_deg

    def helm(self, rngs: Sequence[np.random.Generator], leaving: Departure) -> Steersman:
        """Routes longer than a voyage at 1.5 x its fastest start, or the service speed."""
        way = SPARE * max(leaving.speeds[1], leaving.ship.service_speed) * leaving.duration
        legs = math.ceil(way / self.leg_m[0]) + 1
        routes = [
            self._drawn(rng, legs, (leaving.north, leaving.east), float(psi))
            for rng, psi in zip(rngs, leaving.heading, strict=True)
        ]
        return _followed(routes, self.steering, leaving, rngs, listed=False)

    def _drawn(self, rng: np.random.Generator, legs: int, start: tuple[float, float], heading: float) -> Route:
        lengths = rng.uniform(*self.leg_m, legs)
        turns = np.radians(rng.uniform(*self.turn_deg, legs)) * rng.choice([-1.0, 1.0], legs)
        angles = heading + np.append(0.0, np.cumsum(turns[1:]))
        steps = lengths[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
        return Route(np.concatenate([[start], start + np.cumsum(steps, axis=0)]))


class Courses(BaseModel):
    """Courses over ground as listed: [seconds, degrees from true north], through a reference model of third order; the last is held."""

    model_config = STRICT
    kind: Literal["courses"]
    courses_deg: Series
    turn_rate_deg_s: float | None = Field(None, gt=0)  # the most that is asked for
    steering: Steering = Steering()

    @property
    def rudder_deg(self) -> float:
        """The largest order [deg]."""
        return self.steering.rudder_deg

    def helm(self, rngs: Sequence[np.random.Generator], leaving: Departure) -> Steersman:
        """All voyages steer the same courses."""
        if self.steering.law != "los":
            raise InputError(
                f"manoeuvre.steering: law = {self.steering.law} follows a path, and courses have none; leave it out"
            )
        tuned = Tuned.of(self.steering, leaving)
        navigation = navigation_of(self.steering, leaving, rngs)
        times, courses = np.array(self.courses_deg).T
        order = Orders(times, np.radians(courses) - leaving.convergence)
        rate = math.inf if self.turn_rate_deg_s is None else math.radians(self.turn_rate_deg_s)

        def make(ships: int) -> CourseLoop:
            pilot = CourseAutopilot(tuned.gains, tuned.K, tuned.T, tuned.limit, ships)
            return CourseLoop(
                navigation(ships), [order] * ships, ReferenceModel(tuned.omega_n, 1.0, rate, ships), pilot
            )

        helm = CourseHelm(make)

        def told() -> list[dict[str, str]]:
            assert helm.loop is not None
            return [_limits(helm.loop.autopilot, number, tuned) for number in range(len(rngs))]

        return Steersman(Sampled(helm, tuned.every), told)
