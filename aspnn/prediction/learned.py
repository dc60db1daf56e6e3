"""What every learned predictor does around its network, whatever runs that: history and forcings in, a path out.

No torch is imported here: `gru` gives the network that torch runs, `onnx` the one that onnxruntime runs.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple, Protocol

import numpy as np

from aspnn.frames import to_body
from aspnn.learning.features import begins, forcing, history
from aspnn.learning.servo import Servos
from aspnn.learning.windows import WindowSpec, check_filter, start_wind
from aspnn.motion import Path, integrate, pivot_point, region_map_path, two_station_motion
from aspnn.motion.path import YAW_RATE_FLOOR
from aspnn.orders import Plan
from aspnn.records import States
from aspnn.schema import InputError
from aspnn.vessel import Vessel

# history (n, history_steps, inputs), forcing (n, horizon_steps + 1, forcings), wind (n, 2) -> velocities
# (n, horizon_steps + 1, 3) of surge, bow and stern sway [m/s]; float64 outside, float32 within.
Network = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]


MOVING = ("surge", "sway_bow", "sway_stern")  # inputs that are velocities over ground


class Contract(Protocol):
    """What a checkpoint says of its network, beside the weights."""

    @property
    def name(self) -> str: ...

    @property
    def spec(self) -> WindowSpec: ...

    @property
    def vessel(self) -> Vessel: ...

    @property
    def servos(self) -> Servos | None: ...


class Material(NamedTuple):
    """What a network sees of n starts: `history` (n, steps, inputs) with the heading (n, steps) [rad] then, `forcing`, `wind`, and
    the pose (n, 3) at the start: north, east [m], heading [rad]."""

    history: np.ndarray
    heading: np.ndarray
    forcing: np.ndarray
    wind: np.ndarray
    pose: np.ndarray


def material(contract: Contract, states: States, rows: np.ndarray, plans: Sequence[Plan]) -> Material:
    """What the network sees at `rows` (n,) under `plans`. Raises InputError for want of history."""
    spec, time = contract.spec, states["time_s"]
    servos = contract.servos or Servos.of(contract.vessel)
    states = servos.sailed(states)
    past = history(states, rows, spec.inputs, spec.history_steps, spec.period)
    if "rudder_order" in spec.inputs:
        past[:, -1, spec.inputs.index("rudder_order")] = [plan.rudder.at(0.0) for plan in plans]
    instants = time[rows][:, None] + spec.period * np.arange(1 - spec.history_steps, 1)
    known = [
        forcing(servos, begin, plan, spec.forcings, spec.time)
        for begin, plan in zip(begins(servos, states, rows), plans, strict=True)
    ]
    pose = np.stack([states[k][rows] for k in ("north_m", "east_m", "heading_rad")], axis=-1)
    heading = np.interp(instants, time, states["heading_rad"])
    return Material(past, heading, np.stack(known), start_wind(states, rows, spec.wind_memory), pose)


def through_water(given: Material, spec: WindowSpec, current: np.ndarray) -> Material:
    """The material as seen from water that flows with `current` (n, 2) [m/s]: velocities of ship and air relative to it."""
    ahead, athwart = to_body(current[:, :1], current[:, 1:], given.heading)
    past = given.history.copy()
    flows = {
        **dict(zip(MOVING, (ahead, athwart, athwart), strict=True)),
        "wind_forward": ahead,
        "wind_starboard": athwart,
    }
    for name, flow in flows.items():
        if name in spec.inputs:
            past[..., spec.inputs.index(name)] -= flow
    felt = given.wind - np.array([ahead[:, -1], athwart[:, -1]]).T * given.wind.any(axis=1, keepdims=True)
    return given._replace(history=past, wind=felt)


def predict_rows(
    contract: Contract,
    network: Network,
    states: States,
    rows: np.ndarray,
    plans: Sequence[Plan],
    region_map: bool,
    current: np.ndarray | None = None,
) -> Path:
    """Paths (n, steps) from each of `rows` under each of `plans`; only rows up to each start are read.

    With a `current` (n, 2) [m/s] towards grid north and east the network sees motion through the water, and the paths drift.
    """
    check_vessel(states, contract)
    rows = np.asarray(rows, int)
    given = material(contract, states, rows, plans)
    if current is not None:
        given = through_water(given, contract.spec, current)
    velocities = network(given.history, given.forcing, given.wind)
    path = draw(contract, given.pose, velocities, region_map)
    if current is not None:
        path = adrift(path, current)
    return replace(path, convergence=states["convergence_rad"][rows])


def adrift(path: Path, current: np.ndarray) -> Path:
    """A path (n, steps) through water that flows with `current` (n, 2) [m/s], over ground."""
    north, east = current[:, :1], current[:, 1:]
    ahead, athwart = to_body(north, east, path.heading)
    sway = path.sway + athwart
    return replace(
        path,
        north=path.north + north * path.time,
        east=path.east + east * path.time,
        surge=path.surge + ahead,
        sway=sway,
        pivot=pivot_point(sway, path.yaw_rate, YAW_RATE_FLOOR / 3),
    )


def draw(contract: Contract, pose: np.ndarray, velocities: np.ndarray, region_map: bool) -> Path:
    """Path (n, steps) from `pose` (n, 3) by the mean velocities of each step: by the region map, or by the exact step."""
    period, (bow, stern) = contract.spec.period, contract.vessel.sway_stations
    mean = (velocities[:, 1:] + velocities[:, :-1]) / 2
    if region_map:
        surge, sway_bow, sway_stern = np.moveaxis(mean, -1, 0)
        return region_map_path(pose, surge, sway_bow, sway_stern, period, bow, stern, contract.vessel.length)
    sway, yaw_rate = two_station_motion(mean[..., 1], mean[..., 2], bow, stern)
    return integrate(pose, np.array([mean[..., 0], sway, yaw_rate]).transpose(1, 2, 0), period)


def check_vessel(states: States, contract: Contract) -> None:
    """Refuse states of another vessel, with other sway stations, or of a filter that the network does not know.

    Another loading of the vessel will do. Raises InputError naming both.
    """
    have, want = states.vessel, contract.vessel
    if have.ship != want.ship:
        raise InputError(
            f"{states.path or 'states'}: vessel {have.name}, but checkpoint {contract.name} was trained on {want.name}"
        )
    other = have.other_hull(want)
    if other is not None:
        what, a, b = other
        raise InputError(
            f"{states.path or 'states'}: {what} {a:g} m of {have.name}, the checkpoint was trained with {b:g} m"
        )
    check_filter(states, contract.spec, contract.name)
