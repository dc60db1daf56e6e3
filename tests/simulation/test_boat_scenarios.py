"""The boat's scenarios: what they record, when, and that the manoeuvres, current and attitude are those they were made for."""

from pathlib import Path

import numpy as np
import pytest

from aspnn.checks import check_log
from aspnn.simulation import read_scenario, simulate_scenario

FOLDER = Path(__file__).parents[2] / "data/scenarios"
COLUMNS = [
    *("time_s", "gnss_latitude_deg", "gnss_longitude_deg", "gnss_height_m", "heading_deg", "yaw_rate_deg_s"),
    *(f"acceleration_{axis}_m_s2" for axis in ("surge", "sway", "heave")),
    *(f"imu_force_{axis}_m_s2" for axis in "xyz"),
    *(f"imu_rate_{axis}_deg_s" for axis in "xyz"),
    *("rudder_order_deg", "rudder_angle_deg", "shaft_speed_rps", "roll_deg", "pitch_deg"),
]
CURRENT = {"train": (0.0, 1.25), "test-sheared": (0.0, 1.0)}  # least and most; of the others 1 m/s
KINDS = ("port-turn", "starboard-turn", "train", "test", "test-sheared", "rough", "trial", "trial-test")


def voyages(name, count=1, **change):
    return list(simulate_scenario(read_scenario(FOLDER / f"{name}.toml").model_copy(update=change), count))


@pytest.mark.parametrize("kind", KINDS)
def test_a_scenario_records_what_the_paper_had(kind):
    """Oracle: Paper VI's period, the columns of the contract, no gap; the current is that of the file's name."""
    (log, truth), *_ = voyages(f"workboat8-{kind}", duration_s=40.0)
    check_log(log)
    assert list(log.table.columns) == COLUMNS
    assert not log.table.isna().any(axis=None)
    np.testing.assert_allclose(np.diff(log.table["time_s"]), 0.13, atol=1e-9)
    least, most = CURRENT.get(kind, (1.0, 1.0))
    current = np.hypot(truth["current_north_m_s"], truth["current_east_m_s"])
    assert current.min() >= least - 1e-3 and current.max() <= most + 1e-3
    assert log.vessel.mounting.sign == -1.0 and log.vessel.heights["gnss"] == 2.0


@pytest.mark.parametrize(
    ("name", "begins", "side"), [("workboat8-port-turn", 4, -1), ("workboat8-starboard-turn", 3, 1)]
)
def test_the_turns_are_those_of_paper_vi(name, begins, side):
    """Oracle: the paper's times, to a sample; the boat turns to that side by most of a circle or more before 40 s are over."""
    for log, truth in voyages(name, 3):
        order, time = log.table["rudder_order_deg"].round(9), log.table["time_s"]
        assert set(order[time < begins]) == {0.0} and set(order[time >= begins]) == {side * 30.0}
        assert abs(truth["heading_rad"].iloc[-1] - truth["heading_rad"][0]) > 4
        assert np.sign(truth["heading_rad"].iloc[-1] - truth["heading_rad"][0]) == side
        assert time.iloc[-1] == pytest.approx(40, abs=0.13)


def test_the_rough_sea_rolls_and_pitches_the_boat():
    """Statistic of the files themselves: every voyage of three rolls to 8 degrees or more, the worst beyond 10; pitch beyond 5."""
    rolls, pitches = zip(
        *(
            (np.degrees(t["roll_rad"].abs().max()), np.degrees(t["pitch_rad"].abs().max()))
            for _, t in voyages("workboat8-rough", 3)
        ),
        strict=True,
    )
    assert min(rolls) > 8 and max(rolls) > 10 and max(pitches) > 5


def test_the_loaded_boat_is_another_boat():
    """Law: more mass and damping, a weaker leg: under the same order it turns more slowly than the boat that models are made for."""
    change = {"duration_s": 40.0, "environment": read_scenario(FOLDER / "zigzag-20-20.toml").environment}
    turns = []
    for vessel in ("workboat8", "workboat8_loaded"):
        (_, truth), *_ = voyages("workboat8-starboard-turn", vessel=vessel, **change)
        turns.append(np.degrees(truth["yaw_rate_rad_s"].iloc[-1]))
    assert 0 < turns[1] < 0.9 * turns[0]
