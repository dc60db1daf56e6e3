"""Ships: a vessel file become something that moves, with its model, actuators, wind loads and what waves do to it."""

import math
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from aspnn.guidance import helms
from aspnn.schema import InputError
from aspnn.simulation.actuators import Servo
from aspnn.simulation.environment.waves import Box
from aspnn.simulation.environment.wind import Air
from aspnn.simulation.integrate import calm, rates_of
from aspnn.simulation.ships.coefficients import coefficients
from aspnn.simulation.ships.dynamics import Model
from aspnn.simulation.ships.mariner import Mariner
from aspnn.simulation.ships.mmg import Mmg
from aspnn.simulation.ships.otter import Otter
from aspnn.simulation.ships.shallow import shallow
from aspnn.simulation.ships.trimaran import Trimaran
from aspnn.simulation.ships.workboat import Workboat
from aspnn.vessel import Vessel

MODELS: dict[str, Any] = {"mmg": Mmg, "mariner": Mariner, "otter": Otter, "trimaran": Trimaran, "workboat": Workboat}
KNOT = 1852 / 3600  # m/s
ASTERN, DRIFT, YAW, BACKING, SLOW = 1, 2, 4, 8, 16  # bits of `outside`
FASTEST = 1.5  # greatest product of step and fastest mode; Runge-Kutta of order 4 is stable up to 2.8


class Domain(NamedTuple):
    """Where a model has data: drift angle [rad] and yaw rate |r| L / U up to these, speed [m/s] from this on."""

    drift: float
    yaw: float
    speed: float


@dataclass(frozen=True)
class Ship:
    """What moves: a vessel with its model's coefficients, the servos of rudder, shaft and pitch, wind loads and domain.

    `box` is what waves press on, of a craft of six degrees of freedom; `depth` [m] that of the water its model holds for.
    """

    vessel: Vessel
    model: Model
    rudder: Servo
    shaft: Servo
    pitch: Servo
    air: Air
    domain: Domain
    box: Box | None = None
    depth: float = math.inf

    @staticmethod
    def of(vessel: Vessel) -> "Ship":
        """The ship of a vessel file. Raises InputError naming the vessel and the coefficient that is missing or wrong."""
        sections = [name for name in MODELS if name in vessel.simulator]
        if len(sections) != 1:
            raise InputError(
                f"{vessel.label}: has {' and '.join(sections) or 'none'} of the sections {', '.join(MODELS)};"
                f" one is needed to simulate it"
            )
        model = MODELS[sections[0]].of(vessel)
        service, pitch = model.balance(vessel.service_speed)
        bounds = {"drift_deg": (1, 180), "yaw": (0.1, 100), "least_speed_m_s": (0, 60)}
        domain = coefficients(vessel, "domain", bounds, {"drift_deg": 30, "yaw": 1.2, "least_speed_m_s": 0.0})
        return Ship(
            vessel,
            model,
            rudder=Servo(
                *(-vessel.rudder_max, vessel.rudder_max, vessel.rudder_rate, 0.0, vessel.dead_band),
                vessel.steering_delay,
            ),
            shaft=_engine(vessel, service),
            pitch=_hub(vessel, pitch),
            air=Air.of(vessel),
            box=model.box if isinstance(model, Otter | Workboat) else None,
            domain=Domain(math.radians(domain["drift_deg"]), domain["yaw"], domain["least_speed_m_s"]),
        )

    def at_depth(self, depth: float) -> "Ship":
        """The ship in water of a steady `depth` [m]. Raises InputError where its model has no correction for that."""
        if math.isinf(depth):
            return self
        if not isinstance(self.model, Mmg):
            raise InputError(f"{self.vessel.label}: its model has no shallow-water correction; leave the depth out")
        return replace(self, model=shallow(self.model, self.vessel.beam, depth), depth=depth)

    @property
    def name(self) -> str:
        """The vessel's."""
        return self.vessel.name

    @property
    def service_speed(self) -> float:
        """The vessel's [m/s]."""
        return self.vessel.service_speed

    @property
    def compiled(self) -> tuple:
        """What `integrate` takes."""
        return self.model, self.air, (self.rudder, self.shaft, self.pitch)

    @property
    def columns(self) -> int:
        """Columns of its state rows."""
        return helms.COLUMNS if self.model.DEGREES == 3 else helms.SIX

    def start(self, north, east, heading, speed) -> np.ndarray:
        """Start states (batch, columns) straight ahead at `speed` [m/s] through the water, rudder amidships, shaft (and of
        six degrees the attitude) in balance. Raises InputError for a speed that the engine cannot hold."""
        states = np.zeros((*np.broadcast_shapes(*(np.shape(x) for x in (north, east, heading, speed))), self.columns))
        states[..., helms.NORTH], states[..., helms.EAST] = north, east
        states[..., helms.HEADING], states[..., helms.SURGE] = heading, speed
        states = np.atleast_2d(states)
        for row in states:
            row[helms.SHAFT], row[helms.PITCH_RATIO] = self.model.balance(row[helms.SURGE])
            if not self.shaft.least <= row[helms.SHAFT] <= self.shaft.most:
                raise InputError(
                    f"{self.vessel.label}: {row[helms.SURGE]:.4g} m/s ({row[helms.SURGE] / KNOT:.4g} kn) needs"
                    f" {row[helms.SHAFT]:.3g} rev/s of the shaft, whose engine gives {self.shaft.least:.3g} to {self.shaft.most:.3g}"
                )
            if isinstance(self.model, Otter | Workboat):
                row[helms.DOWN], row[helms.ROLL], row[helms.PITCH] = self.model.attitude(row[helms.SURGE])
                row[helms.HEAVE] = row[helms.SURGE] * math.tan(row[helms.PITCH])  # level
        return states

    def outside(self, states: np.ndarray) -> np.ndarray:
        """Why each state (n, columns) is beyond what the model has data for, bits (n,), 0 inside.

        ASTERN sternway, DRIFT, YAW and SLOW beyond the domain, BACKING propeller or pitch reversed.
        """
        u, v, r = states[:, helms.SURGE], states[:, helms.SWAY], states[:, helms.YAW_RATE]
        speed = np.hypot(u, v)
        bits = np.where(u < 0, ASTERN, 0)
        bits |= np.where(np.abs(v) > speed * math.sin(min(self.domain.drift, math.pi / 2)), DRIFT, 0)
        bits |= np.where(np.abs(r) * self.vessel.length > self.domain.yaw * speed, YAW, 0)
        bits |= np.where(speed < self.domain.speed, SLOW, 0)
        return bits | np.where((states[:, helms.SHAFT] < 0) | (states[:, helms.PITCH_RATIO] < 0), BACKING, 0)

    def largest_step(self, speed: float | None = None) -> float:
        """The longest integration step [s] for the fastest mode of the ship about a straight course at `speed` [m/s].

        FASTEST over the spectral radius of the velocities' (and the attitude's) Jacobian, by central differences; 1 s at most.
        """
        state = self.start(0.0, 0.0, 0.0, self.vessel.service_speed if speed is None else speed)[0]
        moving = [
            i for i in range(helms.SURGE, self.columns) if i not in (helms.RUDDER, helms.SHAFT, helms.PITCH_RATIO)
        ]
        step = 1e-5
        bent = np.array([state + sign * step * (np.arange(self.columns) == i) for i in moving for sign in (1, -1)])
        rates = rates_of(self.compiled, calm(1), 0, 0.0, bent)[:, moving]
        modes = np.linalg.eigvals((rates[::2] - rates[1::2]).T / (2 * step))
        return min(1.0, FASTEST / float(np.abs(modes).max()))


def _engine(vessel: Vessel, service: float) -> Servo:
    """The engine: section `engine`, else assumed: 1.2 x service shaft speed ahead, 0.7 astern, and stopped from service in the
    time the ship takes for 1.5 of its lengths."""
    slow = 1.5 * vessel.length / vessel.service_speed
    default = {
        "least_rps": -0.7 * service,
        "most_rps": 1.2 * service,
        "rate_rps_s": service / slow,
        "lag_s": 0.0,
        "delay_s": 0.0,
    }
    bounds = {
        "least_rps": (-300, 0),
        "most_rps": (0, 300),
        "rate_rps_s": (1e-4, 1e4),
        "lag_s": (0, 60),
        "delay_s": (0, 60),
    }
    found = coefficients(vessel, "engine", bounds, default)
    if service > found["most_rps"]:
        raise InputError(
            f"{vessel.label}: engine.most_rps = {found['most_rps']:g} is below the {service:.4g} that service speed needs"
        )
    return Servo(found["least_rps"], found["most_rps"], found["rate_rps_s"], found["lag_s"], 0.0, found["delay_s"])


def _hub(vessel: Vessel, service: float) -> Servo:
    """The pitch hub: section `pitch`, else assumed: 0.7 of the service pitch astern, 1.1 ahead, from one to the other in 30 s.

    A propeller of fixed pitch has none: NaN is its pitch and its order.
    """
    if math.isnan(service):
        return Servo(-math.inf, math.inf)
    bounds = {"least": (-2.0, 0.0), "most": (0.1, 2.0), "rate_per_s": (1e-4, 10.0), "delay_s": (0.0, 60.0)}
    default = {"least": -0.7 * service, "most": 1.1 * service, "rate_per_s": 0.06 * service, "delay_s": 0.0}
    found = coefficients(vessel, "pitch", bounds, default)
    return Servo(found["least"], found["most"], found["rate_per_s"], 0.0, 0.0, found["delay_s"])
