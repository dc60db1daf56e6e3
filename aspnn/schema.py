"""The vocabulary of tables: every column of logs, truth and states, with unit, frame and meaning.

`data/README.md` is generated from these tables and a test holds the two equal. Units stand in the names, because a table
is an edge of the program; inside functions everything is SI and radians. Starboard and forward are positive, heading is
clockwise. A missing sensor is an absent column or NaN, never zero.
"""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from difflib import get_close_matches
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pandas as pd


class InputError(ValueError):
    """Something the user gave is wrong. The message is one line: file, row or time, column, what to do."""


@dataclass(frozen=True)
class Column:
    """One column of a table. `name` may hold NAME, which stands for an antenna (`bow`, `stern`, `midship`, ...)."""

    name: str
    unit: str
    frame: str
    meaning: str
    needed: bool = False

    def matches(self, column: str) -> bool:
        """Whether a table's column name is this column."""
        return re.fullmatch(self.name.replace("NAME", "[a-z][a-z0-9]*"), column) is not None


DOMAIN = (
    "where the ship's model has no data: the sum of 1 astern, 2 drift and 4 yaw rate beyond its range, 8 engine astern, 16 too slow;"
    " absent from voyages that keep inside"
)
LOG = (
    Column("time_s", "s", "-", "time from the start of the log, strictly increasing", needed=True),
    Column("NAME_latitude_deg", "deg", "WGS 84", "latitude of antenna NAME, north positive"),
    Column("NAME_longitude_deg", "deg", "WGS 84", "longitude of antenna NAME, east positive"),
    Column("NAME_north_m", "m", "local grid", "northing of antenna NAME, where the log has no geodetic position"),
    Column("NAME_east_m", "m", "local grid", "easting of antenna NAME, where the log has no geodetic position"),
    Column("NAME_height_m", "m", "WGS 84", "height of antenna NAME above the ellipsoid, up positive"),
    Column("heading_deg", "deg", "true north", "heading, clockwise, 0 to 360"),
    Column("yaw_rate_deg_s", "deg/s", "body", "yaw rate (rate of turn), starboard positive"),
    Column("roll_deg", "deg", "body", "roll, starboard side down positive"),
    Column("pitch_deg", "deg", "body", "pitch, bow up positive"),
    Column("acceleration_surge_m_s2", "m/s2", "body", "acceleration forward at the IMU, gravity removed"),
    Column("acceleration_sway_m_s2", "m/s2", "body", "acceleration to starboard at the IMU, gravity removed"),
    Column("acceleration_heave_m_s2", "m/s2", "body", "acceleration downward at the IMU, gravity removed"),
    *(
        Column(
            f"imu_force_{axis}_m_s2", "m/s2", "IMU", f"accelerometer along the IMU's own {axis} axis, gravity included"
        )
        for axis in "xyz"
    ),
    *(Column(f"imu_rate_{axis}_deg_s", "deg/s", "IMU", f"rate gyro about the IMU's own {axis} axis") for axis in "xyz"),
    Column("rudder_order_deg", "deg", "-", "rudder order; positive turns the ship to starboard"),
    Column("rudder_angle_deg", "deg", "-", "measured rudder angle; positive turns the ship to starboard"),
    Column("engine_order_rps", "rev/s", "-", "ordered shaft speed, ahead positive"),
    Column("shaft_speed_rps", "rev/s", "-", "measured shaft speed, ahead positive"),
    Column("propeller_pitch_ratio", "-", "-", "propeller pitch over diameter, ahead positive"),
    Column("speed_through_water_m_s", "m/s", "body", "longitudinal speed through the water, ahead positive"),
    Column("course_over_ground_deg", "deg", "true north", "course over ground, clockwise, 0 to 360"),
    Column("speed_over_ground_m_s", "m/s", "-", "speed over ground"),
    Column("wind_speed_true_m_s", "m/s", "ground", "true wind speed"),
    Column("wind_from_true_deg", "deg", "true north", "direction the true wind blows from"),
    Column("depth_m", "m", "-", "water depth"),
    Column("out_of_domain", "bits", "-", f"simulated logs only: {DOMAIN}"),
)

TRUTH = (
    Column("time_s", "s", "-", "time from the start of the log", needed=True),
    Column("north_m", "m", "UTM grid", "northing of midship", needed=True),
    Column("east_m", "m", "UTM grid", "easting of midship", needed=True),
    Column("heading_rad", "rad", "grid north", "heading", needed=True),
    Column("surge_m_s", "m/s", "body, over ground", "surge at midship", needed=True),
    Column("sway_m_s", "m/s", "body, over ground", "sway at midship", needed=True),
    Column("yaw_rate_rad_s", "rad/s", "body", "yaw rate", needed=True),
    Column("rudder_angle_rad", "rad", "-", "rudder angle, positive turns to starboard", needed=True),
    Column("shaft_speed_rps", "rev/s", "-", "shaft speed", needed=True),
    Column("current_north_m_s", "m/s", "UTM grid", "velocity of the water to the north", needed=True),
    Column("current_east_m_s", "m/s", "UTM grid", "velocity of the water to the east", needed=True),
    Column("wind_speed_true_m_s", "m/s", "ground", "true wind speed", needed=True),
    Column("wind_from_grid_rad", "rad", "grid north", "direction the true wind blows from", needed=True),
    Column("roll_rad", "rad", "body", "roll, starboard side down positive; absent where the ship keeps upright"),
    Column("pitch_rad", "rad", "body", "pitch, bow up positive; absent as roll"),
    Column("heave_m", "m", "down", "how far midship is below its place at rest; absent as roll"),
    Column("propeller_pitch_ratio", "-", "-", "propeller pitch over diameter; absent where it is fixed"),
    Column("out_of_domain", "bits", "-", DOMAIN),
)

_ESTIMATES = (
    Column("north_m", "m", "UTM or local grid", "northing of midship", needed=True),
    Column("east_m", "m", "UTM or local grid", "easting of midship", needed=True),
    Column("heading_rad", "rad", "grid north", "heading, continuous (not wrapped)", needed=True),
    Column("surge_m_s", "m/s", "body, over ground", "surge at midship", needed=True),
    Column("sway_m_s", "m/s", "body, over ground", "sway at midship", needed=True),
    Column("yaw_rate_rad_s", "rad/s", "body", "yaw rate", needed=True),
    Column("surge_acceleration_m_s2", "m/s2", "body", "time derivative of surge", needed=True),
    Column("sway_acceleration_m_s2", "m/s2", "body", "time derivative of sway", needed=True),
    Column("yaw_acceleration_rad_s2", "rad/s2", "body", "time derivative of the yaw rate", needed=True),
)

_OF_COURSE = (
    Column(
        "course_rad",
        "rad",
        "grid north",
        "course over ground of the antenna, continuous; this and what follows of the course filter, which takes no heading",
    ),
    Column("speed_over_ground_m_s", "m/s", "ground", "speed over ground of the antenna"),
    Column("course_rate_rad_s", "rad/s", "-", "time derivative of the course"),
)

STATES = (
    Column("time_s", "s", "-", "time from the start of the log", needed=True),
    *_ESTIMATES,
    *(Column(f"{c.name}_sd", c.unit, c.frame, f"standard deviation of {c.name}", needed=True) for c in _ESTIMATES),
    Column("convergence_rad", "rad", "-", "grid convergence: true heading minus grid heading", needed=True),
    Column("sway_bow_m_s", "m/s", "body, over ground", "sway at the bow station", needed=True),
    Column("sway_stern_m_s", "m/s", "body, over ground", "sway at the stern station", needed=True),
    Column("drift_rad", "rad", "body", "drift angle: heading minus course over ground", needed=True),
    Column("rudder_order_rad", "rad", "-", "rudder order in force", needed=True),
    Column(
        "rudder_angle_rad",
        "rad",
        "-",
        "rudder angle: measured, else the order through the vessel's rudder servo",
        needed=True,
    ),
    Column("shaft_speed_rps", "rev/s", "-", "shaft speed in force; NaN where the log has none", needed=True),
    Column("engine_order_rps", "rev/s", "-", "ordered shaft speed in force; NaN where the log has none", needed=True),
    Column("wind_speed_true_m_s", "m/s", "ground", "true wind speed; NaN where the log has none", needed=True),
    Column(
        "wind_from_grid_rad",
        "rad",
        "grid north",
        "direction the true wind blows from; NaN where the log has none",
        needed=True,
    ),
    Column("innovation_heading_rad", "rad", "grid north", "measured minus predicted heading"),
    Column("innovation_yaw_rate_rad_s", "rad/s", "body", "measured minus predicted yaw rate"),
    Column("innovation_NAME_north_m", "m", "grid", "measured minus predicted northing of antenna NAME"),
    Column("innovation_NAME_east_m", "m", "grid", "measured minus predicted easting of antenna NAME"),
    Column("innovation_surge_m_s2", "m/s2", "body", "measured minus predicted acceleration forward"),
    Column("innovation_sway_m_s2", "m/s2", "body", "measured minus predicted acceleration to starboard"),
    Column("nis_heading", "-", "-", "normalised innovation squared of the heading, 1 degree of freedom"),
    Column("nis_yaw_rate", "-", "-", "normalised innovation squared of the yaw rate, 1 degree of freedom"),
    Column(
        "innovation_NAME_down_m",
        "m",
        "down",
        "measured minus predicted place of antenna NAME downward; three dimensions only",
    ),
    Column(
        "nis_NAME",
        "-",
        "-",
        "normalised innovation squared of antenna NAME, 2 degrees of freedom; 3 in three dimensions where it has a height",
    ),
    Column("nis_acceleration", "-", "-", "normalised innovation squared of the accelerations, 2 degrees of freedom"),
    Column("gated", "bool", "-", "a fix was rejected by the chi-square gate", needed=True),
    Column(
        "stale", "bool", "-", "a fix repeats its predecessor, or another sensor sticks, and was not used", needed=True
    ),
    Column(
        "coasting",
        "bool",
        "-",
        "no position has been used for longer than two seconds (of the course filter: than twice the interval of the fixes, if that is longer)",
        needed=True,
    ),
    *_OF_COURSE,
    *(Column(f"{c.name}_sd", c.unit, c.frame, f"standard deviation of {c.name}") for c in _OF_COURSE),
    Column(
        "roll_rad",
        "rad",
        "body",
        "roll, starboard side down positive; this and what follows of filters in three dimensions",
    ),
    Column("pitch_rad", "rad", "body", "pitch, bow up positive"),
    Column("down_m", "m", "down", "place of midship below the ellipsoid (the height turned round)"),
    Column("down_velocity_m_s", "m/s", "down", "velocity of midship downward"),
    Column("down_m_sd", "m", "down", "standard deviation of down_m"),
    Column("down_velocity_m_s_sd", "m/s", "down", "standard deviation of down_velocity_m_s"),
    *(
        Column(f"accelerometer_bias_{way}_m_s2", "m/s2", "body", f"what the accelerometers read too much {to}")
        for way, to in (("forward", "forward"), ("starboard", "to starboard"), ("down", "downward"))
    ),
    *(
        Column(f"gyro_bias_{way}_rad_s", "rad/s", "body", f"what the rate gyros read too much about the {axis} axis")
        for way, axis in (("roll", "x"), ("pitch", "y"), ("yaw", "z"))
    ),
)


def check(table: "pd.DataFrame", columns: Iterable[Column], where: str = "table") -> None:
    """Hold a table to its contract: all needed columns present, no unknown ones.

    Raises InputError that names `where` (usually the file), the column and the nearest known name.
    """
    columns = tuple(columns)
    for name in table.columns:
        if not any(c.matches(str(name)) for c in columns):
            near = get_close_matches(str(name), [c.name for c in columns], 1, 0.5)
            hint = f", did you mean {near[0]}?" if near else ""
            raise InputError(f"{where}: column {name} is not known{hint} (data/README.md lists the columns)")
    for column in columns:
        if column.needed and column.name not in table.columns:
            raise InputError(f"{where}: column {column.name} is missing ({column.meaning} [{column.unit}])")


def antennas(columns: Iterable[str]) -> list[str]:
    """Names of the antennas that have a position among `columns`, in their order."""
    found = (re.fullmatch("([a-z][a-z0-9]*)_(latitude_deg|north_m)", str(c)) for c in columns)
    return [m[1] for m in found if m]


def markdown() -> str:
    """The column tables as Markdown: what `data/README.md` holds between its markers."""
    parts = []
    for title, columns in (("Log", LOG), ("Truth (simulated logs only)", TRUTH), ("States", STATES)):
        rows = [f"| `{c.name}` | {c.unit} | {c.frame} | {c.meaning} | {'yes' if c.needed else ''} |" for c in columns]
        parts.append(
            "\n".join(
                [f"### {title}", "", "| column | unit | frame | meaning | needed |", "|---|---|---|---|---|", *rows]
            )
        )
    return "\n\n".join(parts) + "\n"
