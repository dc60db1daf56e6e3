"""Sensors: what the instruments of a simulated ship record, each at its own rate and with its own white noise."""

from typing import Annotated

import numpy as np
import pandas as pd
from pydantic import ConfigDict, Field
from pydantic.dataclasses import dataclass

from aspnn.angles import compass
from aspnn.frames import Zone, convergence, station_acceleration, to_geodetic, to_north_east
from aspnn.schema import InputError
from aspnn.simulation.voyage import Voyage
from aspnn.vessel import Vessel

NotNegative = Annotated[float, Field(ge=0)]


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class Sensors:
    """Rates [Hz] and standard deviations of the sensors; the defaults are those of the thesis. Rate 0: not on board.

    `position_m` is that of each of north and east, for every antenna; antennas are stations of the vessel.
    """

    antennas: tuple[str, ...] = ("bow", "stern")
    position_hz: NotNegative = 10.0
    position_m: NotNegative = 1.0
    heading_hz: NotNegative = 10.0
    heading_deg: NotNegative = 0.5
    yaw_rate_hz: NotNegative = 10.0
    yaw_rate_deg_s: NotNegative = 0.01
    acceleration_hz: NotNegative = 10.0
    acceleration_m_s2: NotNegative = 0.01
    rudder_hz: NotNegative = 10.0  # order and angle; the order is exact
    rudder_angle_deg: NotNegative = 0.0
    shaft_hz: NotNegative = 10.0
    shaft_rps: NotNegative = 0.0


def measure(voyage: Voyage, vessel: Vessel, zone: Zone, sensors: Sensors, rng: np.random.Generator) -> pd.DataFrame:
    """The table of a log (schema.LOG) that `sensors` record of a voyage, one row per epoch at which any of them samples.

    NaN where a sensor has no sample; each rate must divide that of the voyage's steps. Positions are those of the vessel's
    stations named in `sensors.antennas`. The voyage lies on the plane of the UTM grid: its scale (0.9996 to 1.001) is
    ignored, so a metre of the ship is a metre of the grid. The accelerometer at the station `imu` reads z_au = u' - v r,
    z_av = v' + u r moved to it (thesis 3.16-3.17, E1, E5). Every sensor draws its noise for all steps, whatever its rate.
    """
    steps, base = len(voyage.time), round(1 / float(voyage.time[1] - voyage.time[0]), 6)  # Hz
    sampled = {rate: np.arange(steps) % _stride(rate, base, getattr(sensors, rate)) == 0 for rate in _on(sensors)}
    rows = np.any(list(sampled.values()), axis=0)
    table: dict[str, np.ndarray] = {"time_s": voyage.time}

    def record(rate: str, **columns: tuple[np.ndarray, float]) -> None:
        """Add columns, each truth and standard deviation."""
        noise = rng.standard_normal((len(columns), steps))
        if rate in sampled:
            for (name, (truth, sd)), error in zip(columns.items(), noise, strict=True):
                table[name] = np.where(sampled[rate], truth + sd * error, np.nan)

    heading, u, v, r = voyage.heading, voyage.surge, voyage.sway, voyage.yaw_rate
    for antenna in sensors.antennas:
        if antenna not in vessel.stations:
            raise InputError(
                f"vessel {vessel.name}: antenna {antenna} has no station; add stations_m.{antenna} = [x, y]"
            )
        north, east = to_north_east(*vessel.stations[antenna], heading)
        grid = {"north": voyage.north + north, "east": voyage.east + east}
        record("position_hz", **{f"{antenna}_{axis}": (value, sensors.position_m) for axis, value in grid.items()})
        latitude, longitude = to_geodetic(table.pop(f"{antenna}_north"), table.pop(f"{antenna}_east"), zone)
        table[f"{antenna}_latitude_deg"] = np.degrees(latitude)
        table[f"{antenna}_longitude_deg"] = np.degrees(longitude)
    latitude, longitude = to_geodetic(voyage.north, voyage.east, zone)
    gamma = convergence(latitude, longitude, zone)
    record("heading_hz", heading_deg=(np.degrees(heading + gamma), sensors.heading_deg))
    if "heading_hz" in sampled:
        table["heading_deg"] = np.degrees(compass(np.radians(table["heading_deg"])))
    record("yaw_rate_hz", yaw_rate_deg_s=(np.degrees(r), sensors.yaw_rate_deg_s))
    forward, starboard = station_acceleration(
        voyage.surge_rate - v * r,
        voyage.sway_rate + u * r,
        r,
        voyage.yaw_acceleration,
        vessel.stations["imu"],
    )
    record(
        "acceleration_hz",
        acceleration_surge_m_s2=(forward, sensors.acceleration_m_s2),
        acceleration_sway_m_s2=(starboard, sensors.acceleration_m_s2),
    )
    record(
        "rudder_hz",
        rudder_order_deg=(np.degrees(voyage.order), 0.0),
        rudder_angle_deg=(np.degrees(voyage.rudder), sensors.rudder_angle_deg),
    )
    record("shaft_hz", shaft_speed_rps=(voyage.shaft, sensors.shaft_rps))
    return pd.DataFrame(table)[rows].reset_index(drop=True)


RATES = ("position_hz", "heading_hz", "yaw_rate_hz", "acceleration_hz", "rudder_hz", "shaft_hz")


def _on(sensors: Sensors) -> list[str]:
    """The rates of the sensors that are on board. Raises InputError when there is no position, which every log needs."""
    if sensors.position_hz == 0 or not sensors.antennas:
        raise InputError("sensors: a log needs the position of an antenna; set position_hz and antennas")
    return [rate for rate in RATES if getattr(sensors, rate) > 0]


def _stride(what: str, base: float, rate: float) -> int:
    """How many steps of the voyage (at `base` Hz) there are to a sample. Raises InputError unless it is a whole number."""
    every = round(base / rate)
    if every < 1 or abs(base / rate - every) > 1e-6:
        raise InputError(f"sensors.{what} = {rate:g} Hz must divide {base:g} Hz, the rate of the simulation's steps")
    return every
