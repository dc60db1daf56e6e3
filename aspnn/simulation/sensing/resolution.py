"""Rounding as sentences of NMEA 0183 do it: with how many decimals instruments tell."""

from typing import Annotated

import numpy as np
import pandas as pd
from pydantic import ConfigDict, Field
from pydantic.dataclasses import dataclass

KNOT = 1852 / 3600  # m/s

Step = Annotated[float, Field(ge=0)]


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class Resolution:
    """The section `[sensors.resolution]`: the least step of each quantity in the unit of its sentence; 0: not rounded.

    The defaults are what common instruments send; a precise receiver has position_min = 1e-7.
    """

    position_min: Step = 1e-4  # GGA: minutes of arc, 0.19 m
    height_m: Step = 0.1
    heading_deg: Step = 0.1  # HDT
    yaw_rate_deg_min: Step = 0.1  # ROT
    rudder_deg: Step = 0.1  # RSA, ROR
    shaft_rpm: Step = 0.1  # RPM, PRC
    propeller_pitch_percent: Step = 0.1  # RPM
    speed_kn: Step = 0.1  # VTG, VBW
    course_deg: Step = 0.1  # VTG
    attitude_deg: Step = 0.1  # XDR
    acceleration_m_s2: Step = 0.001  # XDR
    wind_m_s: Step = 0.1  # MWV
    wind_deg: Step = 0.1
    depth_m: Step = 0.1  # DPT


# ending of a column: field of Resolution, units of the sentence to one of the column
STEPS = {
    "_latitude_deg": ("position_min", 60.0),
    "_longitude_deg": ("position_min", 60.0),
    "_height_m": ("height_m", 1.0),
    "heading_deg": ("heading_deg", 1.0),
    "yaw_rate_deg_s": ("yaw_rate_deg_min", 60.0),
    "rudder_order_deg": ("rudder_deg", 1.0),
    "rudder_angle_deg": ("rudder_deg", 1.0),
    "engine_order_rps": ("shaft_rpm", 60.0),
    "shaft_speed_rps": ("shaft_rpm", 60.0),
    "propeller_pitch_ratio": ("propeller_pitch_percent", 100.0),
    "speed_through_water_m_s": ("speed_kn", 1 / KNOT),
    "speed_over_ground_m_s": ("speed_kn", 1 / KNOT),
    "course_over_ground_deg": ("course_deg", 1.0),
    "roll_deg": ("attitude_deg", 1.0),
    "pitch_deg": ("attitude_deg", 1.0),
    "acceleration_surge_m_s2": ("acceleration_m_s2", 1.0),
    "acceleration_sway_m_s2": ("acceleration_m_s2", 1.0),
    "acceleration_heave_m_s2": ("acceleration_m_s2", 1.0),
    "wind_speed_true_m_s": ("wind_m_s", 1.0),
    "wind_from_true_deg": ("wind_deg", 1.0),
    "depth_m": ("depth_m", 1.0),
}
BEARINGS = ("heading_deg", "course_over_ground_deg", "wind_from_true_deg")


def rounded(table: pd.DataFrame, resolution: Resolution) -> pd.DataFrame:
    """The table of a log with every value at a whole number of steps; bearings stay below 360."""
    columns = {}
    for column in table.columns:
        found = next((place for ending, place in STEPS.items() if column.endswith(ending)), None)
        step = getattr(resolution, found[0]) if found else 0.0
        if found and step > 0:
            value = np.round(table[column].to_numpy() * found[1] / step) * step / found[1] + 0.0
            columns[column] = value % 360.0 if column in BEARINGS else value
    return table.assign(**columns)
