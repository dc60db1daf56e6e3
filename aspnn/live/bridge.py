"""A simulated bridge: a ship of a scenario that is steered live, and other ships about her, told by the sentences a real one sends.

Pure: `advance(now)` steps ship and sensors to an instant and returns the lines that were sent since. The integrator, sea and servos
are those of every simulation; the sensors are sampled in the simplest way that the filters expect: each on board (a rate above 0 in
the scenario's `[sensors]`) every stride of steps with white noise of its standard deviation, without delay and without the faults of
the other sections (`gnss`, `gyrocompass`, ...). First-order wave motion of ships of three degrees of freedom is left out likewise.
"""

import math
from datetime import UTC, datetime
from typing import Any

import numpy as np
import pandas as pd

from aspnn.angles import compass
from aspnn.frames import Zone, convergence, station_acceleration, station_velocity, to_body, to_geodetic, to_grid
from aspnn.guidance import helms
from aspnn.live.traffic import made_up, named
from aspnn.logs.ais_write import to_ais
from aspnn.logs.maps import utc
from aspnn.logs.nmea_write import to_nmea
from aspnn.records import Log
from aspnn.schema import InputError
from aspnn.simulation.actuators import delay_steps, within_stops
from aspnn.simulation.integrate import rates_of, run_batch
from aspnn.simulation.motion import over_ground
from aspnn.simulation.scenario import Scenario
from aspnn.simulation.ship import Ship
from aspnn.vessel import Vessel, load_vessel

CHANNEL = "bridge"  # the channel of her sentences
CATCH_UP = 60.0  # s: a longer pause of the caller is skipped, not caught up
MOST_WIND = 3600.0  # s of gusts that are drawn; then the last holds
STATIC = 60.0  # s between the AIS messages that tell names and sizes
KNOT = 1852 / 3600


class SimulatedBridge:
    """The ship of a scenario, under way from `began` [s, UNIX]. Rudder, shaft and weather are as the scenario starts."""

    def __init__(self, scenario: Scenario, began: float, traffic: bool = True) -> None:
        self.scenario, self.dt = scenario, scenario.step_s
        self.vessel = load_vessel(scenario.vessel)
        self.ship = Ship.of(self.vessel).at_depth(scenario.environment.depth_m)
        self.zone = Zone.parse(scenario.start.zone)
        self.began, self.step = began, 0
        plan, noise, sea = (np.random.default_rng(s) for s in np.random.SeedSequence(scenario.seed).spawn(3))
        self._rng = noise
        start = scenario.start
        angle = math.radians(start.latitude_deg), math.radians(start.longitude_deg)
        north, east = (float(x) for x in to_grid(*angle, self.zone))
        gamma = float(convergence(*angle, self.zone))
        ranges = (start.speed_kn, start.heading_deg, *scenario.environment.ranges)
        drawn = np.array([[plan.uniform(*pair) for pair in ranges]])
        heading = compass(np.radians(drawn[:, 1]) - gamma)
        self.state = self.ship.start(north, east, heading, drawn[:, 0] * KNOT)
        steps = round(min(scenario.duration_s, MOST_WIND) / self.dt)
        weather = scenario.environment.draw(drawn[:, 2:], gamma, (north, east), [sea], self.dt, steps)
        self.water = weather.around(self.ship, 1)
        self.rudder, self.shaft = 0.0, float(self.state[0, helms.SHAFT])
        self._servos = self.ship.rudder, self.ship.shaft
        late = [delay_steps(servo, self.dt) for servo in self._servos]
        self._heard: list[list[float]] = [[0.0] * late[0], [self.shaft] * late[1]]
        self._strides = self._sampled()
        ships = scenario.bridge.ships
        if not traffic:
            self.traffic = []
        elif ships is not None:
            self.traffic = named(ships, self.zone)
        else:
            self.traffic = made_up(
                complex(north, east), float(heading[0]), self.vessel.length, float(self.state[0, helms.SURGE])
            )

    @property
    def time(self) -> float:
        """The simulated time [s, UNIX]."""
        return self.began + self.step * self.dt

    @property
    def orders(self) -> dict[str, Any]:
        """The orders in force, as the situation has them: rudder [deg], shaft [rev/s]."""
        return {
            "rudder_order": round(math.degrees(self.rudder), 3),
            "shaft_order": round(self.shaft, 4),
            "shaft_max": round(float(self.ship.shaft.most), 4),
            "scenario": self.scenario.name,
        }

    def order(self, rudder: float | None = None, shaft: float | None = None) -> None:
        """Order the rudder [rad], the shaft [rev/s] or both. Raises InputError beyond the stops; then nothing is changed."""
        if rudder is not None and not abs(rudder) <= self.vessel.rudder_max + 1e-9:
            raise InputError(
                f"rudder order {math.degrees(rudder):.4g} deg is beyond the {math.degrees(self.vessel.rudder_max):g} deg stops"
                f" of {self.vessel.name}"
            )
        if shaft is not None:
            within_stops(self.ship.shaft, shaft, f"{self.vessel.name}: a shaft order [rev/s]")
        self.rudder = self.rudder if rudder is None else float(rudder)
        self.shaft = self.shaft if shaft is None else float(shaft)

    def advance(self, now: float) -> list[tuple[float, str]]:
        """Step to `now` [s, UNIX]: the lines sent on the way, in order, each with the time it was sent. A pause beyond CATCH_UP is
        skipped: the clock goes on, the ship waits."""
        if now - self.time > CATCH_UP:
            self.began = now - CATCH_UP - self.step * self.dt
        sent: list[tuple[float, str]] = []
        while self.time + self.dt <= now + 1e-9:
            self._advance()
            row = self.sample()
            lines = list(to_nmea(self._log(row))) if row else []
            sent += [(self.time, line.rstrip("\r\n")) for line in (*lines, *self._reports())]
        return sent

    def _advance(self) -> None:
        told = []
        for queue, order in zip(self._heard, (self.rudder, self.shaft), strict=True):
            queue.append(order)
            told.append(queue.pop(0))
        now = np.array([[[*told, self.state[0, helms.PITCH_RATIO]]]])
        two = np.stack([self.state, self.state], axis=1)
        run_batch(self.ship.compiled, self.water, self.step, now, self.dt, two)
        self.state = two[:, 1].copy()
        self.step += 1
        for other in self.traffic:
            other.move(self.dt)

    def sample(self) -> dict[str, float]:
        """What the sensors tell now: columns of schema.LOG; empty where none samples at this step."""
        wanted = {what for what, stride in self._strides.items() if self.step % stride == 0}
        s, sensors, noise = self.state, self.scenario.sensors, self._rng.standard_normal
        current = self.water.current[0]
        rates = rates_of(self.ship.compiled, self.water, 0, self.dt, s)
        motion = over_ground(s, rates, current[None], np.zeros((1, 2)))
        north, east, heading, u, v, r = (float(values[0]) for values in motion[:6])
        u_rate, v_rate, r_rate = (float(values[0]) for values in motion[6:9])
        latitude, longitude = to_geodetic(north, east, self.zone)
        true = heading + float(convergence(latitude, longitude, self.zone))
        row: dict[str, float] = {}
        if "position" in wanted:
            for antenna in sensors.antennas:
                forward, starboard = self.vessel.stations[antenna]
                off = (forward + 1j * starboard) * np.exp(1j * heading)
                error = sensors.position_m * noise(2)
                place = to_geodetic(north + off.real + error[0], east + off.imag + error[1], self.zone)
                row[f"{antenna}_latitude_deg"], row[f"{antenna}_longitude_deg"] = (math.degrees(x) for x in place)
        if "course" in wanted:
            ahead, athwart = station_velocity(u, v, r, self.vessel.stations[sensors.antennas[0]])
            velocity = complex(ahead, athwart) * np.exp(1j * true) + sensors.course_m_s * complex(*noise(2))
            row["course_over_ground_deg"] = math.degrees(np.angle(velocity)) % 360
            row["speed_over_ground_m_s"] = abs(velocity)
        if "heading" in wanted:
            row["heading_deg"] = (math.degrees(true) + sensors.heading_deg * noise()) % 360
        if "yaw_rate" in wanted:
            row["yaw_rate_deg_s"] = math.degrees(r) + sensors.yaw_rate_deg_s * noise()
        if "acceleration" in wanted:
            # The IMU feels u' - v r and v' + u r, moved to its station (thesis 3.16-3.17, E1, E5).
            felt = station_acceleration(u_rate - v * r, v_rate + u * r, r, r_rate, self.vessel.stations["imu"])
            for axis, value in zip(("surge", "sway"), felt, strict=True):
                row[f"acceleration_{axis}_m_s2"] = value + sensors.acceleration_m_s2 * noise()
        if "rudder" in wanted:
            row["rudder_order_deg"] = math.degrees(self.rudder)
            row["rudder_angle_deg"] = math.degrees(s[0, helms.RUDDER]) + sensors.rudder_angle_deg * noise()
        if "shaft" in wanted:
            row["shaft_speed_rps"] = float(s[0, helms.SHAFT]) + sensors.shaft_rps * noise()
        if "engine_order" in wanted:
            row["engine_order_rps"] = self.shaft
        if "speed_log" in wanted:
            row["speed_through_water_m_s"] = (
                u - float(to_body(current[0], current[1], heading)[0]) + sensors.speed_log_m_s * noise()
            )
        if "wind" in wanted:
            wind = self.water.wind[0, min(self.step, self.water.wind.shape[1] - 1)] + sensors.wind_m_s * noise(2)
            row["wind_speed_true_m_s"] = float(np.hypot(*wind))
            row["wind_from_true_deg"] = math.degrees(math.atan2(-wind[1], -wind[0]) + true - heading) % 360
        return row

    def _sampled(self) -> dict[str, int]:
        """Steps between the samples of each sensor on board. Raises InputError for a rate above that of the steps."""
        sensors, base = self.scenario.sensors, 1 / self.dt
        found = {}
        for what in SAMPLED:
            rate = getattr(sensors, f"{what}_hz")
            if rate > base + 1e-9:
                raise InputError(
                    f"scenario {self.scenario.name}: sensors.{what}_hz = {rate:g} is above {base:g}, that of the steps"
                )
            if rate > 0:
                found[what] = max(1, round(base / rate))
        if "position" not in found:
            raise InputError(f"scenario {self.scenario.name}: a bridge needs positions; set sensors.position_hz")
        missing = [name for name in sensors.antennas if name not in self.vessel.stations]
        if missing:
            raise InputError(
                f"{self.vessel.label}: antenna {missing[0]} has no station; add stations_m.{missing[0]} = [x, y]"
            )
        return found

    def _log(self, row: dict[str, float], vessel: Vessel | None = None) -> Log:
        table = pd.DataFrame({"time_s": [0.0], **{name: [value] for name, value in row.items()}})
        return Log(table=table, vessel=vessel or self.vessel, zone=self.zone, start=utc_of(self.time), voyage="bridge")

    def _reports(self) -> list[str]:
        """The AIS sentences of the others that are due: static data first, and now and then again."""
        lines: list[str] = []
        for k, other in enumerate(self.traffic):
            if self.time < other.due - 1e-9:
                continue
            latitude, longitude = to_geodetic(other.place.real, other.place.imag, self.zone)
            true = math.degrees(other.heading + float(convergence(latitude, longitude, self.zone))) % 360
            row = {
                "midship_latitude_deg": math.degrees(latitude),
                "midship_longitude_deg": math.degrees(longitude),
                "course_over_ground_deg": true,
                "speed_over_ground_m_s": other.speed,
                "heading_deg": true,
                "yaw_rate_deg_s": math.degrees(other.rate),
            }
            said = list(to_ais(self._log(row, other.vessel), other.mmsi, other.name))
            static = self.time >= other.static_due - 1e-9
            lines += said if static else said[-1:]
            # After the first report each has a slot of her own, as transponders do.
            slot = (k + 1) / len(self.traffic) if other.due == 0 else 1.0
            other.due = self.time + slot * other.every
            if static:
                other.static_due = self.time + slot * STATIC
        return lines


SAMPLED = (
    *(
        "position",
        "course",
        "heading",
        "yaw_rate",
        "acceleration",
        "rudder",
        "shaft",
        "engine_order",
        "speed_log",
        "wind",
    ),
)


def utc_of(time: float) -> str:
    """An instant [s, UNIX] as a log's start has it, to the millisecond."""
    return utc(datetime.fromtimestamp(round(time, 3), UTC))
