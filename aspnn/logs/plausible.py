"""Whether a log agrees with itself: columns that measure the same motion must tell the same, or a map is wrong.

A wrong sign or unit shows as a factor between two columns; it is named with the entry of the map to change. A check that has
too little movement to decide says nothing.
"""

from collections.abc import Iterator

import numpy as np
import pandas as pd

from aspnn import schema
from aspnn.angles import unwrap, wrap
from aspnn.frames import Zone, to_grid
from aspnn.logs.maps import TIMES, CsvMap
from aspnn.logs.units import UNITS, units_of
from aspnn.records import Log

FEWEST = 6  # spans that must move before a check decides
FASTEST = 40.0  # m/s
GRAVITY = UNITS["m/s2"]["g"]


def _wrong(plan: CsvMap, column: str, factor: float | None, what: str) -> Iterator[str]:
    """The wrong sign or unit behind `factor`, recorded over expected, and the entry to change; nothing where it is about 1."""
    if factor is None or 2 / 3 < factor < 1.5:
        return
    source, units = plan.columns[column], units_of(column)
    problem = f"column {source.column} is {factor:.3g} times {what}"
    remedies = [f"columns.{column}.sign = {-source.sign}"] if factor < 0 else []
    # A number in another unit that was read in the map's is the ratio of the two too large.
    unit = next((u for u, size in units.items() if u != source.unit and _near(factor, units[source.unit] / size)), None)
    if unit is not None:
        yield f"{problem}, so it is in {unit}; set {' and '.join([*remedies, f'columns.{column}.unit = {unit!r}'])}"
    elif 2 / 3 < -factor < 1.5:
        yield f"{problem}, so its sign is wrong; set {remedies[0]}"
    else:
        yield f"{problem}; check columns.{column}.unit, time.unit and the units of the positions"


def _near(factor: float, ratio: float) -> bool:
    """Whether a factor, of either sign, comes within 12 % of a ratio that is not 1."""
    return abs(ratio - 1) > 1e-9 and abs(abs(factor) / ratio - 1) < 0.12


def _factor(recorded: np.ndarray, expected: np.ndarray, floor) -> float | None:
    """Median of recorded over expected where that is beyond `floor`; None with too few of them, or where they scatter."""
    use = np.isfinite(recorded) & (np.abs(expected) >= floor)
    if use.sum() < FEWEST:
        return None
    ratio = recorded[use] / expected[use]
    middle = float(np.median(ratio))
    return middle if np.median(np.abs(ratio - middle)) <= 0.3 * abs(middle) else None


def problems(log: Log, plan: CsvMap) -> Iterator[str]:
    """What is wrong with signs and units, the surest first, as sentences that end with the entry of the map to change."""
    yield from _misplaced(log, plan)
    time = log.table["time_s"].to_numpy(float)
    natural = 0.5 * log.vessel.length / log.vessel.service_speed
    m = _spans(log, max(natural, 2 * float(np.median(np.diff(time)))))
    whole = _spans(log, float(time[-1] - time[0]) / 60)
    if m is None or whole is None:
        return
    yield from _mistimed(whole, log, plan)
    fast = m["speed"].to_numpy() > FASTEST
    sustained = np.flatnonzero(fast[2:] & fast[1:-1] & fast[:-2])
    if len(sustained):
        row = int(m["row"].iloc[sustained[0]])
        yield (
            f"row {row} (time {log.table['time_s'].iloc[row]:g} s): the positions move at "
            f"{m['speed'].iloc[sustained[0]]:.3g} m/s and go on so; check time.unit, the positions' columns and units"
        )
    speed, service = m["speed"].to_numpy(), log.vessel.service_speed
    moving, columns = speed > 0.2 * service, [c for c in plan.columns if c in m]
    if "speed_over_ground_m_s" in columns:
        factor = _factor(m["speed_over_ground_m_s"].to_numpy(), speed, 0.2 * service)
        yield from _wrong(plan, "speed_over_ground_m_s", factor, "the speed of the positions")
    for column in ("heading_deg", "course_over_ground_deg"):
        if column in columns:
            yield from _bearing(m[moving], column, plan)
    if "heading_deg" not in columns:
        return
    if "speed_through_water_m_s" in columns:
        what = "the speed of the positions less a current"
        yield from _wrong(plan, "speed_through_water_m_s", _through_water(m[moving]), what)
    turn = m["turn"].to_numpy()
    floor = np.maximum(np.radians(3), 6 * m["noise"].to_numpy()) / m["span"].to_numpy()
    if "yaw_rate_deg_s" in columns:
        factor = _factor(np.radians(m["yaw_rate_deg_s"].to_numpy()), turn, floor)
        yield from _wrong(plan, "yaw_rate_deg_s", factor, "the rate at which heading_deg turns")
    if "acceleration_sway_m_s2" in columns:
        # In a turn the accelerometer reads z_av = v' + u r (E1), of which u r is by far the larger part. Forward it reads
        # u' - v r, two small parts of opposite sign, which decide nothing. Heel lets in 0.17 m/s2 of gravity per degree:
        # only a clear factor of g or of -1 is an error.
        expected = np.where(np.abs(turn) >= floor, speed * turn, 0.0)
        factor = _factor(m["acceleration_sway_m_s2"].to_numpy(), expected, 0.05 * service**2 / log.vessel.length)
        if factor and (2 / 3 < -factor < 1.5 or _near(factor, GRAVITY) or _near(factor, 1 / GRAVITY)):
            yield from _wrong(plan, "acceleration_sway_m_s2", factor, "speed times the rate of turn, even in a turn")


def _misplaced(log: Log, plan: CsvMap) -> Iterator[str]:
    """Geodetic positions that are exchanged, or far from the zone that the map names."""
    for antenna in schema.antennas(log.table.columns):
        names = f"{antenna}_latitude_deg", f"{antenna}_longitude_deg"
        if log.zone is None or any(name not in log.table for name in names):
            continue
        latitude, longitude = (float(np.nanmedian(log.table[name])) for name in names)
        first, second = (f"columns.{name}" for name in names)
        here = f"antenna {antenna} is at latitude {latitude:.4g}, longitude {longitude:.4g}"
        if _off(longitude, log.zone) > 12:
            if _off(latitude, log.zone) <= 12 and abs(longitude) <= 90:
                yield f"{here}, which lies in zone {log.zone} the other way round; exchange {first} and {second}"
            elif _off(-longitude, log.zone) <= 12:
                sign = -plan.columns[names[1]].sign
                yield f"{here}, on the other side of Greenwich than zone {log.zone}; set {second}.sign = {sign}"
            elif abs(latitude) <= 90:
                right = Zone.of(np.radians(latitude), np.radians(longitude))
                yield f'{here}, far from zone {log.zone}; set zone = "{right}", or correct the units of {first} and {second},'
        elif abs(latitude) > 1 and (latitude > 0) != log.zone.north:
            other, sign = Zone(log.zone.number, not log.zone.north), -plan.columns[names[0]].sign
            yield f'{here}, in the other hemisphere than zone {log.zone}; set zone = "{other}" or {first}.sign = {sign}'


def _off(longitude: float, zone: Zone) -> float:
    """Degrees between a longitude and the middle of a zone."""
    return abs((longitude - (6 * zone.number - 183) + 180) % 360 - 180)


def _mistimed(m: pd.DataFrame, log: Log, plan: CsvMap) -> Iterator[str]:
    """Times in another unit, by the recorded speed or, without one, because no ship is so fast.

    Over spans that are a part of the log, whatever its times: those of a ship are too short or long in the wrong unit.
    """
    if plan.time.unit not in TIMES or m.empty:
        return
    speed, service = float(np.median(m["speed"])), log.vessel.service_speed
    recorded = next((np.abs(m[c]) for c in ("speed_over_ground_m_s", "speed_through_water_m_s") if c in m), None)
    true = float(np.nanmedian(recorded)) if recorded is not None and recorded.notna().any() else None
    for unit, size in TIMES.items():
        ratio = TIMES[plan.time.unit] / size
        if unit == plan.time.unit:
            continue
        if true is None:
            right = speed > FASTEST and 0.2 * service < ratio * speed < 1.5 * service
        else:
            right = true > 0.2 * service and 0.7 < ratio * speed / true < 1.3
        if right:
            yield (
                f"column {' '.join(plan.time.columns)}: by it the positions move at {speed:.3g} m/s, the ship at "
                f"{true if true is not None else ratio * speed:.3g} m/s, so it is in {unit}; set time.unit = {unit!r}"
            )


def _spans(log: Log, length: float) -> pd.DataFrame | None:
    """The motion between blocks of `length` [s] (half the time in which the ship runs her own), by pairs of neighbours.

    `row` of the log, `span` [s], `speed` [m/s], `course` [rad] and `turn` [rad/s] from the positions and headings; `noise`
    [rad], the standard deviation of a turn over the span; and every column of the log, averaged over both blocks (headings and
    courses continuous). None where no antenna has a position.
    """
    table = log.table
    names = schema.antennas(table.columns)
    if not names:
        return None
    time = table["time_s"].to_numpy(float)
    means = table.copy()
    means["row"] = np.arange(len(table))
    for bearing in {"heading_deg", "course_over_ground_deg"} & set(table.columns):
        means[bearing] = np.degrees(unwrap(np.radians(table[bearing])))
    antenna = names[0]
    places = [f"{antenna}_latitude_deg", f"{antenna}_longitude_deg"]
    if places[0] in table and places[1] in table and log.zone is not None:
        if not (table[places[0]].abs() <= 90).eq(table[places[0]].notna()).all():
            return None  # check_log names the row
        means["north"], means["east"] = to_grid(np.radians(table[places[0]]), np.radians(table[places[1]]), log.zone)
    elif f"{antenna}_north_m" in table and f"{antenna}_east_m" in table:
        means["north"], means["east"] = table[f"{antenna}_north_m"], table[f"{antenna}_east_m"]
    else:
        return None
    block = np.floor(time / length)
    rows = means.groupby(block)["row"].min()
    means = means.groupby(block).mean()
    after, before = means.iloc[1:], means.iloc[:-1]
    beside = np.diff(means.index) == 1
    spans = ((after.to_numpy() + before.to_numpy()) / 2)[beside]
    found = pd.DataFrame(spans, columns=means.columns)
    step = pd.DataFrame((after.to_numpy() - before.to_numpy())[beside], columns=means.columns)
    found["row"], found["span"] = rows.to_numpy()[:-1][beside], step["time_s"]
    found["speed"] = np.hypot(step["north"], step["east"]) / step["time_s"]
    found["course"] = np.arctan2(step["east"], step["north"])
    if "heading_deg" in table:
        found["turn"] = np.radians(step["heading_deg"]) / step["time_s"]
        heading = table["heading_deg"].dropna().to_numpy(float)
        jitter = np.abs(wrap(np.radians(np.diff(heading, 2))))
        noise = 1.4826 * float(np.median(jitter)) / np.sqrt(6) if len(jitter) else 0.0
        found["noise"] = noise * np.sqrt(2 * len(means) / max(len(heading), 1))
    return found


def _bearing(m: pd.DataFrame, column: str, plan: CsvMap) -> Iterator[str]:
    """A heading (or course) that fits the course of the positions only in another unit, or mirrored; needs a ship that turns."""
    m = m[m[column].notna()]
    course, value = m["course"].to_numpy(), m[column].to_numpy()
    if len(m) < FEWEST or abs(np.mean(np.exp(1j * course))) > 0.95:
        return
    source, units = plan.columns[column], units_of(column)

    def miss(degrees: np.ndarray) -> float:
        return float(np.degrees(np.median(np.abs(wrap(course - np.radians(degrees))))))

    choices = [
        (miss(value * size / units[source.unit]), f"it is in {unit}; set columns.{column}.unit = {unit!r}")
        for unit, size in units.items()
        if unit != source.unit
    ]
    choices += [
        (miss(-value), f"its sign is wrong; set columns.{column}.sign = {-source.sign}"),
        (
            miss(90 - value),
            "north and east are exchanged; exchange the columns of the positions (or, if the angle is counted from east "
            f"anticlockwise, set columns.{column}.sign = {-source.sign} and .offset = {90 - source.offset:g})",
        ),
    ]
    fit, remedy = min(choices)
    if miss(value) > 30 and fit < min(15, miss(value) / 3):
        yield f"column {source.column} is {miss(value):.0f} degrees off the course of the positions: {remedy}"


def _through_water(m: pd.DataFrame) -> float | None:
    """Speed through water over what it must be: velocity over ground = speed along the heading / factor + a steady current.

    Least squares; None unless the headings are spread enough to tell a factor from a current.
    """
    m = m[m["speed_through_water_m_s"].notna() & m["heading_deg"].notna()]
    heading, speed, water = np.radians(m["heading_deg"]), m["speed"], m["speed_through_water_m_s"].to_numpy()
    if len(m) < 2 * FEWEST or abs(np.mean(np.exp(1j * heading.to_numpy()))) > 0.8 or not np.any(water):
        return None
    ahead = water * np.exp(1j * heading.to_numpy())
    ground = (speed * np.exp(1j * m["course"])).to_numpy()
    ahead, ground = ahead - ahead.mean(), ground - ground.mean()
    slope = float(np.real(np.vdot(ahead, ground)) / np.real(np.vdot(ahead, ahead)))
    left = float(np.mean(np.abs(ground - slope * ahead) ** 2) / np.mean(np.abs(ground) ** 2))
    return 1 / slope if left < 0.25 and slope != 0 else None


def oddities(log: Log) -> dict[str, str]:
    """What looks odd but may be so, as notes: a late yaw rate, and a rudder that turns the ship the other way.

    A wrong sign of the rudder cannot be told for sure: counter-rudder, wind, current and thrusters turn ships against it.
    """
    table = log.table
    notes: dict[str, str] = {}
    if not {"heading_deg", "yaw_rate_deg_s"} <= set(table.columns):
        return notes
    late = _late(log)
    if late:
        notes["yaw_rate_deg_s"] = f"{abs(late):.2g} s {'late' if late > 0 else 'early'} against heading_deg"
    for column in ("rudder_angle_deg", "rudder_order_deg"):
        if column in table:
            both = table[["yaw_rate_deg_s", column]].interpolate(limit_direction="both").to_numpy(float)
            slow = 0.1 * np.degrees(log.vessel.service_speed / log.vessel.length)
            turning = (np.abs(both[:, 0]) > slow) & (np.abs(both[:, 1]) > 3)
            against = float(np.mean(both[turning, 0] * both[turning, 1] < 0)) if turning.sum() >= 50 else 0.0
            if against > 0.7:
                notes[f"{column}_sign"] = (
                    f"the ship turns against {column} in {against:.0%} of her turning; if port is positive in the source, "
                    f"turn columns.{column}.sign"
                )
    return notes


def _late(log: Log) -> float:
    """How late [s] the yaw rate is against the heading: the lag of best correlation; 0 where it is small or not clear."""
    table = log.table
    time = table["time_s"].to_numpy(float)
    heading = unwrap(np.radians(table["heading_deg"].to_numpy(float)))
    rate = np.radians(table["yaw_rate_deg_s"].to_numpy(float))
    known, read = np.isfinite(heading), np.isfinite(rate)
    if known.sum() < 50 or read.sum() < 50:
        return 0.0
    half = 0.25 * log.vessel.length / log.vessel.service_speed  # s; short against a manoeuvre, long against noise
    gone = np.concatenate([[0.0], np.cumsum(np.diff(time[read]) * (rate[read][1:] + rate[read][:-1]) / 2)])
    lags = np.arange(-half, half + 1e-9, half / 50)
    at = np.arange(time[0] + 2 * half, time[-1] - 2 * half, max(half / 10, (time[-1] - time[0]) / 1e4))
    if len(at) < 50:
        return 0.0
    turn = np.interp(at + half, time[known], heading[known]) - np.interp(at - half, time[known], heading[known])
    if turn.std() < np.radians(2):
        return 0.0
    shifted = at + lags[:, None]
    integral = np.interp(shifted + half, time[read], gone) - np.interp(shifted - half, time[read], gone)
    likeness = np.array([np.corrcoef(turn, row)[0, 1] for row in integral])
    best = int(np.argmax(likeness))
    small = max(0.1 * half, 2 * float(np.median(np.diff(time[read]))))
    return float(lags[best]) if likeness[best] > 0.95 and abs(lags[best]) >= small else 0.0
