"""Sensors: what the instruments of a simulated ship record, each at its own rate, with its own delay and errors."""

from typing import Annotated

import numpy as np
import pandas as pd
from pydantic import ConfigDict, Field
from pydantic.dataclasses import dataclass

from aspnn.angles import compass
from aspnn.frames import Zone, convergence, to_body, to_geodetic, to_north_east
from aspnn.schema import InputError
from aspnn.simulation.sensing.errors import delayed
from aspnn.simulation.sensing.gnss import Gnss, Receiver, receivers
from aspnn.simulation.sensing.instruments import (
    Gyrocompass,
    Imu,
    RateGyro,
    RudderIndicator,
    body_rates,
    compass_error,
    gyro_reads,
    imu_acceleration,
    imu_reads,
    indicated,
    lever_arm,
    raw_reads,
    tilted,
    unit_errors,
)
from aspnn.simulation.sensing.resolution import Resolution, rounded
from aspnn.simulation.voyage import Voyage
from aspnn.vessel import Vessel

NotNegative = Annotated[float, Field(ge=0)]
Delay = Annotated[float, Field(ge=0, le=60)]


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class Sensors:
    """Rates [Hz], standard deviations and delays of the sensors; the defaults are those of the thesis. Rate 0: not on board.

    `position_m` is that of each of north and east, for every antenna; antennas are stations of the vessel. What a sensor with a
    delay records at t tells the state at t - delay (as instruments.Calibration has it). The sections hold what is worse than white
    noise. With a `period_s` all sensors on board sample together at that period, whatever their rates, as one unit records them
    (Paper VI: every 0.13 s, which is no whole rate). `quantised`, or a section `resolution`, rounds what is recorded as sentences
    of NMEA 0183 do.
    """

    antennas: tuple[str, ...] = ("bow", "stern")
    position_hz: NotNegative = 10.0
    position_m: NotNegative = 1.0
    position_delay_s: Delay = 0.0
    heading_hz: NotNegative = 10.0
    heading_deg: NotNegative = 0.5
    heading_delay_s: Delay = 0.0
    yaw_rate_hz: NotNegative = 10.0
    yaw_rate_deg_s: NotNegative = 0.01
    yaw_rate_delay_s: Delay = 0.0
    acceleration_hz: NotNegative = 10.0
    acceleration_m_s2: NotNegative = 0.01
    acceleration_delay_s: Delay = 0.0
    rudder_hz: NotNegative = 10.0  # order and angle; the order is exact and at once
    rudder_angle_deg: NotNegative = 0.0
    rudder_delay_s: Delay = 0.0
    shaft_hz: NotNegative = 10.0
    shaft_rps: NotNegative = 0.0
    shaft_delay_s: Delay = 0.0
    course_hz: NotNegative = 0.0  # course and speed over ground of the first antenna
    course_m_s: NotNegative = 0.05  # of each of north and east
    course_delay_s: Delay = 0.0
    attitude_hz: NotNegative = 0.0  # roll and pitch
    attitude_deg: NotNegative = 0.1
    attitude_delay_s: Delay = 0.0
    engine_order_hz: NotNegative = 0.0  # exact and at once
    propeller_pitch_hz: NotNegative = 0.0
    propeller_pitch_ratio: NotNegative = 0.0
    propeller_pitch_delay_s: Delay = 0.0
    speed_log_hz: NotNegative = 0.0  # through the water, at midship
    speed_log_m_s: NotNegative = 0.05
    speed_log_delay_s: Delay = 0.0
    wind_hz: NotNegative = 0.0  # true wind
    wind_m_s: NotNegative = 0.5  # of each of north and east
    wind_delay_s: Delay = 0.0
    depth_hz: NotNegative = 0.0
    depth_m: NotNegative = 0.1
    depth_delay_s: Delay = 0.0
    period_s: Annotated[float, Field(gt=0)] | None = None
    quantised: bool = False
    resolution: Resolution | None = None
    gnss: Gnss = Gnss()
    gyrocompass: Gyrocompass = Gyrocompass()
    rate_gyro: RateGyro = RateGyro()
    imu: Imu = Imu()
    rudder_indicator: RudderIndicator = RudderIndicator()


SAMPLED = (
    "position",
    "heading",
    "yaw_rate",
    "acceleration",
    "rudder",
    "shaft",
    "course",
    "attitude",
    "engine_order",
    "propeller_pitch",
    "speed_log",
    "wind",
    "depth",
)
# Streams of random numbers beside the first, which is the white noise of the thesis's sensors; new ones go to the end.
STREAMS = (
    "gnss",
    "height",
    "course",
    "gyro",
    "imu",
    "heave",
    "attitude",
    "engine_order",
    "propeller_pitch",
    "speed_log",
    "wind",
    "depth",
    "raw",
)


def measure(voyage: Voyage, vessel: Vessel, zone: Zone, sensors: Sensors, rng: np.random.Generator) -> pd.DataFrame:
    """The table of a log (schema.LOG) that `sensors` record of a voyage, one row per epoch at which any of them samples.

    NaN where a sensor has no sample; each rate must divide that of the voyage's steps. Positions are those of the vessel's
    stations named in `sensors.antennas`. The voyage lies on the plane of the UTM grid: its scale (0.9996 to 1.001) is
    ignored, so a metre of the ship is a metre of the grid. The accelerometer at the station `imu` reads z_au = u' - v r,
    z_av = v' + u r moved to it (thesis 3.16-3.17, E1, E5). Every sensor draws its noise for all steps, whatever its rate, and
    every error from a stream of its own, so that none moves another.
    """
    dt = float(voyage.time[1] - voyage.time[0])
    log = _Recorder(sensors, voyage.time, _sampled(sensors, len(voyage.time), dt))
    streams = dict(zip(STREAMS, rng.spawn(len(STREAMS)), strict=True))
    latitude, longitude = to_geodetic(voyage.north, voyage.east, zone)
    gamma = convergence(latitude, longitude, zone)
    faults = receivers(sensors.gnss, voyage.time, len(sensors.antennas), streams["gnss"])
    heights = streams["height"].spawn(len(sensors.antennas))
    for antenna, receiver, stream in zip(sensors.antennas, faults, heights, strict=True):
        north, east, up = _place(voyage, vessel, antenna)
        offset, sd = receiver.offset, sensors.position_m
        log.record("position", rng, receiver, north=(north + offset[0], sd), east=(east + offset[1], sd))
        place = to_geodetic(log.table.pop("north"), log.table.pop("east"), zone)
        log.table[f"{antenna}_latitude_deg"], log.table[f"{antenna}_longitude_deg"] = np.degrees(place)
        if sensors.gnss.height_m is not None:
            height = sensors.gnss.sea_level_m + up + offset[2], sensors.gnss.height_m
            log.record("position", stream, receiver, **{f"{antenna}_height_m": height})
    heading = voyage.heading + gamma
    misled = compass_error(sensors.gyrocompass, voyage.time, heading, voyage.surge, voyage.sway, latitude)
    log.record("heading", rng, heading_deg=(np.degrees(heading + misled), sensors.heading_deg))
    turning = body_rates(voyage)[2] if tilted(voyage) else voyage.yaw_rate
    turning = gyro_reads(sensors.rate_gyro, turning, dt, streams["gyro"])
    log.record("yaw_rate", rng, yaw_rate_deg_s=(np.degrees(turning), sensors.yaw_rate_deg_s))
    true = imu_acceleration(voyage, vessel.stations["imu"], vessel.heights.get("imu", 0.0))
    unit = unit_errors(sensors.imu, len(voyage.time), dt, streams["imu"])
    felt = imu_reads(sensors.imu, unit, true, voyage.roll, voyage.pitch)
    sd = sensors.acceleration_m_s2
    log.record("acceleration", rng, acceleration_surge_m_s2=(felt[0], sd), acceleration_sway_m_s2=(felt[1], sd))
    if sensors.imu.heave:
        log.record("acceleration", streams["heave"], acceleration_heave_m_s2=(felt[2], sd))
    if sensors.imu.raw:
        forces, rates = raw_reads(unit, vessel.mounting, true, body_rates(voyage), voyage.roll, voyage.pitch)
        columns = {f"imu_force_{axis}_m_s2": (force, sd) for axis, force in zip("xyz", forces, strict=True)}
        sd_rate = sensors.yaw_rate_deg_s
        turns = {f"imu_rate_{axis}_deg_s": (np.degrees(r), sd_rate) for axis, r in zip("xyz", rates, strict=True)}
        log.record("acceleration", streams["raw"], None, **columns, **turns)
    pointer = np.degrees(indicated(sensors.rudder_indicator, voyage.rudder))
    orders = np.degrees(voyage.order), None
    log.record("rudder", rng, rudder_order_deg=orders, rudder_angle_deg=(pointer, sensors.rudder_angle_deg))
    log.record("shaft", rng, shaft_speed_rps=(voyage.shaft, sensors.shaft_rps))
    _record_others(log, voyage, vessel, gamma, faults[0], streams)
    for name in BEARINGS & set(log.table):
        log.table[name] = np.degrees(compass(np.radians(log.table[name])))
    table = pd.DataFrame(log.table)[log.rows()].reset_index(drop=True)
    resolution = sensors.resolution or (Resolution() if sensors.quantised else None)
    return table if resolution is None else rounded(table, resolution)


BEARINGS = {"heading_deg", "course_over_ground_deg", "wind_from_true_deg"}


class _Recorder:
    """What is recorded so far: `table`, columns over all steps, NaN where a sensor does not sample."""

    def __init__(self, sensors: Sensors, time: np.ndarray, sampled: dict[str, np.ndarray]):
        self.sensors, self.time, self.sampled = sensors, time, sampled
        self.table: dict[str, np.ndarray] = {"time_s": time}

    def record(
        self,
        what: str,
        stream: np.random.Generator,
        receiver: Receiver | None = None,
        **columns: tuple[np.ndarray, float | None],
    ) -> None:
        """Add the columns of a sensor, each truth and standard deviation; without one it is told exactly and at once."""
        noise = stream.standard_normal((len(columns), len(self.time)))
        if what not in self.sampled:
            return
        for (name, (truth, sd)), error in zip(columns.items(), noise, strict=True):
            late = truth if sd is None else delayed(truth, self.time, getattr(self.sensors, f"{what}_delay_s"))
            value = late + (sd or 0.0) * error
            when = self.sampled[what]
            self.table[name] = np.where(when, value, np.nan) if receiver is None else receiver.tell(value, when)

    def rows(self) -> np.ndarray:
        """The steps (steps,) at which any sensor samples."""
        return np.any(list(self.sampled.values()), axis=0)


def _record_others(log: _Recorder, voyage: Voyage, vessel: Vessel, gamma, receiver: Receiver, streams) -> None:
    """The sensors that the thesis does without, where they are on board; each draws from its own stream."""
    sensors, table = log.sensors, log.table
    if "course" in log.sampled:
        dt, sd = float(voyage.time[1] - voyage.time[0]), sensors.course_m_s
        north, east, _ = _place(voyage, vessel, sensors.antennas[0])
        log.record(
            "course",
            streams["course"],
            receiver,
            v_n=(np.gradient(north, dt, edge_order=2), sd),
            v_e=(np.gradient(east, dt, edge_order=2), sd),
        )
        speed, towards = _polar(table.pop("v_n"), table.pop("v_e"))
        table["course_over_ground_deg"], table["speed_over_ground_m_s"] = np.degrees(towards + gamma), speed
    if "attitude" in log.sampled:
        roll, pitch = ((np.degrees(angle), sensors.attitude_deg) for angle in (voyage.roll, voyage.pitch))
        log.record("attitude", streams["attitude"], roll_deg=roll, pitch_deg=pitch)
    log.record("engine_order", streams["engine_order"], engine_order_rps=(voyage.shaft_order, None))
    pitch = voyage.pitch_ratio, sensors.propeller_pitch_ratio
    log.record("propeller_pitch", streams["propeller_pitch"], propeller_pitch_ratio=pitch)
    ahead = voyage.surge - to_body(voyage.current[:, 0], voyage.current[:, 1], voyage.heading)[0]
    log.record("speed_log", streams["speed_log"], speed_through_water_m_s=(ahead, sensors.speed_log_m_s))
    if "wind" in log.sampled:
        north, east = -voyage.wind.T + 0.0  # where it blows from, no negative zeros
        log.record("wind", streams["wind"], w_n=(north, sensors.wind_m_s), w_e=(east, sensors.wind_m_s))
        speed, source = _polar(table.pop("w_n"), table.pop("w_e"))
        table["wind_speed_true_m_s"], table["wind_from_true_deg"] = speed, np.degrees(source + gamma)
    bottom = np.full(
        len(voyage.time), voyage.depth if np.isfinite(voyage.depth) else np.nan
    )  # deep water gives no echo
    log.record("depth", streams["depth"], depth_m=(bottom, sensors.depth_m))


def _polar(north: np.ndarray, east: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return np.hypot(north, east), np.arctan2(east, north)


def _place(voyage: Voyage, vessel: Vessel, antenna: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Northing, easting and height above the still water [m] of an antenna. Raises InputError when it has no station."""
    if antenna not in vessel.stations:
        raise InputError(f"{vessel.label}: antenna {antenna} has no station; add stations_m.{antenna} = [x, y]")
    height = vessel.heights.get(antenna, 0.0)
    forward, starboard, down = lever_arm(voyage, vessel.stations[antenna], height)
    north, east = to_north_east(forward, starboard, voyage.heading)
    return voyage.north + north, voyage.east + east, 0.0 - voyage.heave - down


def _sampled(sensors: Sensors, steps: int, dt: float) -> dict[str, np.ndarray]:
    """The steps at which each sensor on board samples. Raises InputError when there is no position, which every log needs."""
    if sensors.position_hz == 0 or not sensors.antennas:
        raise InputError("sensors: a log needs the position of an antenna; set position_hz and antennas")
    rates = {what: getattr(sensors, f"{what}_hz") for what in SAMPLED}
    strides = {what: _stride(sensors, f"{what}_hz", rate, dt) for what, rate in rates.items() if rate > 0}
    return {what: np.arange(steps) % stride == 0 for what, stride in strides.items()}


def _stride(sensors: Sensors, what: str, rate: float, dt: float) -> int:
    """How many steps `dt` [s] of the voyage there are to a sample. Raises InputError unless it is a whole number."""
    base = round(1 / dt, 6)
    ratio = base / rate if sensors.period_s is None else sensors.period_s / dt
    every = round(ratio)
    if every >= 1 and abs(ratio - every) <= 1e-6:
        return every
    if sensors.period_s is None:
        raise InputError(f"sensors.{what} = {rate:g} Hz must divide {base:g} Hz, the rate of the simulation's steps")
    raise InputError(
        f"sensors.period_s = {sensors.period_s:g} s must be a whole number of the simulation's steps of {dt:g} s; change step_s"
    )
