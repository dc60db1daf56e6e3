"""Vessels: sources for every number, files read back unchanged, and wrong files told in one line."""

import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from aspnn.instruments import Calibration, Mounting, Noise, scaled_noise
from aspnn.schema import InputError
from aspnn.vessel import FOLDER, from_dict, load_vessel, vessels

SECTIONS = ("dimensions", "stations_m", "rudder", "service", "mmg", "wind", "sensors", "process", "imu")


@pytest.mark.parametrize("name", vessels())
def test_every_number_has_a_source(name):
    """House rule: `sources` names each key (`mmg.k0`) or the section that holds it (`mmg`)."""
    data = json.loads((FOLDER / f"{name}.json").read_text())
    numbers = [(section, key) for section in SECTIONS for key in data.get(section, {})]
    assert numbers
    missing = [f"{s}.{k}" for s, k in numbers if not (data["sources"].get(s) or data["sources"].get(f"{s}.{k}"))]
    assert not missing


@pytest.mark.parametrize("name", vessels())
def test_vessel_is_read_back_unchanged(name):
    """Round trip through the plain data and JSON, as logs and checkpoints carry a vessel: bit for bit, many times."""
    vessel = once = load_vessel(name)
    for _ in range(3):
        once = from_dict(json.loads(json.dumps(once.to_dict())))
        assert once == vessel


@given(st.floats(1, 89), st.floats(0.1, 60), st.floats(1e-3, 5))
def test_angles_survive_the_way_through_degrees(max_deg, rate_deg_s, heading_deg):
    """Round trip: radians to degrees and back is not exact in float64, yet a vessel stays equal to itself."""
    data = load_vessel("cargo90").to_dict()
    vessel = from_dict(
        data | {"rudder": {"max_deg": max_deg, "rate_deg_s": rate_deg_s}, "sensors": {"heading_deg": heading_deg}}
    )
    assert vessel.rudder_max == math.radians(max_deg)
    assert from_dict(vessel.to_dict()) == vessel


@given(st.floats(-180, 180), st.floats(0, 5), st.floats(0, 15))
def test_calibration_is_read_back_unchanged(offset, short, long):
    """Round trip, bit for bit; a vessel without calibration has no such section, what a section lacks is zero."""
    data = load_vessel("cargo90").to_dict()
    assert "calibration" not in data
    part = {"heading_offset_deg": offset, "position_delay_s": short, "yaw_rate_delay_s": long}
    vessel = from_dict(data | {"calibration": part})
    expected = Calibration(heading_offset=math.radians(offset), position_delay=short, yaw_rate_delay=long)
    assert vessel.calibration == expected
    assert from_dict(json.loads(json.dumps(vessel.to_dict()))) == vessel


def test_mounting_turns_readings_into_ship_axes():
    """Oracle: scipy's rotations. Paper VI's unit stands upside down (half a turn about x, thesis 3.44) and reads g - a: at rest its
    z axis, which points up, reads -9.81, and the ship's specific force is (0, 0, -9.81). Residual angles turn about z, y, x (3.45)."""
    upside_down = Mounting(("x", "-y", "-z"), sign=-1.0)
    np.testing.assert_allclose(upside_down.matrix() @ [0, 0, -9.81], [0, 0, -9.81])
    np.testing.assert_allclose(upside_down.rotation(), Rotation.from_euler("x", 180, True).as_matrix(), atol=1e-15)
    angles = np.radians([1.2, -0.8, 1.7])
    turned = Mounting(("-y", "x", "z"), tuple(angles), -1.0)
    expected = Rotation.from_euler("ZYX", angles[::-1]) * Rotation.from_euler("z", 90, True)
    np.testing.assert_allclose(turned.rotation(), expected.as_matrix(), atol=1e-14)
    np.testing.assert_array_equal(turned.matrix(), -turned.rotation())
    np.testing.assert_array_equal(Mounting().matrix(), np.eye(3))


@given(
    st.sampled_from([("x", "-y", "-z"), ("z", "x", "y"), ("-y", "x", "z")]),
    st.tuples(*[st.floats(-44, 44)] * 3),
    st.sampled_from(["force", "reaction"]),
)
def test_mounting_is_read_back_unchanged(axes, angles, reads):
    """Round trip, bit for bit; a vessel whose unit lies along its axes has no such section."""
    data = load_vessel("cargo90").to_dict()
    assert "imu" not in data and load_vessel("cargo90").mounting == Mounting()
    vessel = from_dict(data | {"imu": {"axes": list(axes), "misalignment_deg": list(angles), "reads": reads}})
    expected = Mounting(axes, tuple(map(math.radians, angles)), 1.0 if reads == "force" else -1.0)
    assert vessel.mounting == expected
    assert from_dict(json.loads(json.dumps(vessel.to_dict()))) == vessel


@pytest.mark.parametrize("name", vessels())
def test_outline_is_a_hull(name):
    """Geometry: closed, mirror-symmetric, as long and broad as the ship, bow first, running round by starboard."""
    vessel = load_vessel(name)
    x, y = vessel.outline().T
    np.testing.assert_array_equal([x[0], y[0]], [x[-1], y[-1]])
    np.testing.assert_allclose([np.ptp(x), np.ptp(y)], [vessel.length, vessel.beam])
    np.testing.assert_allclose([x[0], y[0]], [vessel.length / 2, 0])
    np.testing.assert_allclose(x, x[::-1])
    np.testing.assert_allclose(y, -y[::-1])
    area = np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]) / 2  # shoelace: positive where x forward turns to y starboard
    assert 0.8 * vessel.length * vessel.beam < area < vessel.length * vessel.beam


def test_cargo90_is_the_ship_of_the_standard_voyages():
    """Architecture: 11.5 kn, antennas at +35 and -35 m, IMU at midship, the thesis's sensors."""
    vessel = load_vessel("cargo90")
    assert (vessel.length, vessel.beam, vessel.draught) == (90, 14, 6.5)
    assert vessel.sway_stations == (35, -35) and vessel.stations["imu"] == (0, 0)
    np.testing.assert_allclose(vessel.service_speed * 3600 / 1852, 11.5, rtol=1e-6)
    np.testing.assert_allclose(np.degrees([vessel.noise.heading, vessel.noise.yaw_rate]), [0.5, 0.01])
    assert (vessel.noise.position, vessel.noise.acceleration) == (1.0, 0.01)


@pytest.mark.parametrize("ratio", [0.1, 4.0])
def test_noise_scales_by_froude(ratio):
    """Similarity: in units of length and sqrt(length / g) the process noise of geometrically similar ships is one number.

    The integral of a jerk of density q over a time t has the variance q t [(m/s2)2], of a yaw jerk q t [(rad/s2)2].
    """
    ship, model = scaled_noise(90.0), scaled_noise(90.0 * ratio)
    time = math.sqrt(ratio)
    np.testing.assert_allclose(model.jerk_density * time, ship.jerk_density)  # accelerations are alike
    np.testing.assert_allclose(model.yaw_jerk_density * time, ship.yaw_jerk_density / ratio**2)  # as 1 / time^4
    assert ship == Noise()


def test_stations_can_be_added():
    """Contract: an importer's antennas join those of the vessel, which itself is left as it was."""
    vessel = load_vessel("cargo90")
    other = vessel.with_stations(mast=(10.0, -2.0))
    assert other.stations == {**vessel.stations, "mast": (10.0, -2.0)}
    assert "mast" not in vessel.stations


@pytest.mark.parametrize(
    "change, words",
    [
        ({"dimensions": {"beam_m": 14, "draught_m": 6}}, "dimensions.length_overall_m is missing"),
        ({"dimensions": {"length_overall_m": -90, "beam_m": 14, "draught_m": 6}}, "length_overall_m = -90 is outside"),
        ({"dimensions": {"length_overall_m": math.nan, "beam_m": 14, "draught_m": 6}}, "length_overall_m = nan"),
        ({"dimensions": 90}, "dimensions must be an object"),
        ({"rudder": {"max_deg": 35, "rate_deg_s": "fast"}}, "rudder.rate_deg_s is missing or not a number"),
        ({"stations_m": {"bow": [35.0]}}, "stations_m must map"),
        ({"stations_m": {"bow": [math.nan, 0.0]}}, "stations_m must map"),
        ({"stations_m": [35, -35]}, "stations_m must be an object"),
        ({"stations_m": {"bow": [1.0, 0.0], "stern": [0.0, 0.0]}}, "lie 1 m apart"),
        ({"sensors": {"jerk_density_m2_s5": 1e-6}}, "sensors.jerk_density_m2_s5 is not a known noise"),
        ({"process": {"jerk_density_m2_s5": 0}}, "process.jerk_density_m2_s5 = 0 must be a positive"),
        ({"dimension": {}}, "did you mean dimensions"),
        ({"calibration": {"position_delay": 0.2}}, "calibration.position_delay is not known, .*position_delay_s"),
        ({"calibration": {"heading_delay_s": -0.1}}, "calibration.heading_delay_s = -0.1 must be .* from 0 to 15"),
        ({"calibration": {"position_delay_s": 5.1}}, "calibration.position_delay_s = 5.1 must be .* from 0 to 5"),
        ({"calibration": {"yaw_rate_delay_s": math.nan}}, "calibration.yaw_rate_delay_s = nan must be"),
        ({"calibration": {"heading_offset_deg": "east"}}, "calibration.heading_offset_deg = east must be"),
        ({"calibration": [0.2]}, "calibration must be an object"),
        ({"imu": {"axis": ["x", "y", "z"]}}, "imu.axis is not known, did you mean axes"),
        ({"imu": {"axes": ["x", "y"]}}, r"imu.axes = .* must be three of x, y, z, -x, -y, -z"),
        ({"imu": {"axes": ["x", "y", "up"]}}, r"imu.axes = .* must be three of"),
        ({"imu": {"axes": "xyz"}}, r"imu.axes = xyz must be three of"),
        ({"imu": {"axes": ["x", "-x", "z"]}}, "name the sensor's axis x more than once; name x, y and z once each"),
        ({"imu": {"axes": ["x", "y", "-z"]}}, "are left-handed.*; turn the sign of one of them"),
        ({"imu": {"misalignment_deg": [1.0, 2.0]}}, "imu.misalignment_deg = .* must be roll, pitch and yaw within 45"),
        ({"imu": {"misalignment_deg": [0, 0, 90]}}, "within 45 degrees; larger turns belong into imu.axes"),
        ({"imu": {"misalignment_deg": [0, 0, math.nan]}}, "imu.misalignment_deg"),
        ({"imu": {"reads": "gravity"}}, r"imu.reads = gravity must be force \(a - g\) or reaction \(g - a\)"),
        ({"imu": ["x", "y", "z"]}, "imu must be an object"),
    ],
)
def test_wrong_vessel_is_one_line(change, words):
    """Contract: InputError that names the file and the key, nothing silently ignored."""
    data = load_vessel("cargo90").to_dict() | change
    with pytest.raises(InputError, match=f"ship.json: .*{words}") as error:
        from_dict(data, "ship.json")
    assert "\n" not in str(error.value)


def test_vessel_that_cannot_be_read_is_one_line(tmp_path):
    """Contract: unknown name, absent file, a folder, not JSON, not an object."""
    (tmp_path / "torn.json").write_text('{"name": ')
    (tmp_path / "list.json").write_text("[]")
    (tmp_path / "folder.json").mkdir()
    for name, words in (
        ("cargo91", "have cargo90"),
        (tmp_path / "absent.json", "absent.json: cannot be read"),
        (tmp_path / "folder.json", "folder.json: cannot be read"),
        (tmp_path / "torn.json", "torn.json: not JSON"),
        (tmp_path / "list.json", "list.json: a vessel file holds one JSON object"),
    ):
        with pytest.raises(InputError, match=words) as error:
            load_vessel(name)
        assert "\n" not in str(error.value)


def test_own_vessel_file(tmp_path):
    """Contract: a user's file by its path; stations and noise that it lacks are those of its length."""
    data = {
        "name": "tug",
        "dimensions": {"length_overall_m": 30, "beam_m": 10, "draught_m": 4},
        "rudder": {"max_deg": 45, "rate_deg_s": 5},
        "service": {"speed_m_s": 6},
    }
    (tmp_path / "tug.json").write_text(json.dumps(data))
    vessel = load_vessel(tmp_path / "tug.json")
    assert vessel.sway_stations == (12, -12)
    assert vessel.noise == scaled_noise(30.0)
