"""Frames against pyproj's geodesics, Kawase's series, scipy's rotations and finite differences of rigid motion."""

import numpy as np
import pytest
from pyproj import Geod, Transformer
from reference import kawase
from scipy.spatial.transform import Rotation

from aspnn import frames
from aspnn.frames import Zone
from aspnn.schema import InputError

PLACES = np.radians([[69.6492, 18.9553], [60.0, 12.5], [5.0, 17.9], [78.2, 15.6], [41.0, 14.9]])  # latitude, longitude
ZONE = Zone(33)
PAPER_III = (8503821.0, 434061.0)  # north, east [m] in zone 33: x_0 of its straight voyage, table 2


def azimuth_of_grid_north(north, east, epsg):
    """True azimuth [rad] of the grid line at a place: mean of the geodesics to 50 m ahead on it and from 50 m behind."""
    to_lonlat = Transformer.from_crs(epsg, 4326, always_xy=True)
    behind, here, ahead = (to_lonlat.transform(east, north + d) for d in (-50.0, 0.0, 50.0))
    earth = Geod(ellps="WGS84")
    to_ahead, to_behind = np.exp(1j * np.radians([earth.inv(*here, *end)[0] for end in (ahead, behind)]))
    return np.angle(to_ahead - to_behind)


def test_grid_is_kawase():
    """Kawase's series (thesis 3.1-3.6, corrected: E43) to 1e-4 m in position and 1e-9 rad in convergence."""
    latitude, longitude = PLACES.T
    north, east, gamma = kawase.grid(latitude, longitude, 33)
    ours = frames.to_grid(latitude, longitude, ZONE)
    np.testing.assert_allclose(ours[0], north, rtol=0, atol=1e-4)
    np.testing.assert_allclose(ours[1], east, rtol=0, atol=1e-4)
    np.testing.assert_allclose(frames.convergence(latitude, longitude, ZONE), gamma, rtol=0, atol=1e-9)


def test_printed_coefficient_is_a_misprint():
    """Published size of the misprint (E43) at the start of Paper III's voyage: a northing 1.44e6 m away."""
    north, east = PAPER_III
    printed, _, _ = kawase.grid(*frames.to_geodetic(north, east, ZONE), 33, kawase.PRINTED_ALPHA)
    np.testing.assert_allclose(printed - north, 1.44e6, rtol=0, atol=0.005e6)


@pytest.mark.parametrize("zone, epsg", [(Zone(33), 32633), (Zone(56, north=False), 32756)])
def test_grid_is_pyproj_transformer(zone, epsg):
    """pyproj Transformer of the zone's own EPSG code; both hemispheres; there and back."""
    latitude = np.radians([70.0, 1.0, 35.0]) * (1 if zone.north else -1)
    longitude = np.radians(6 * zone.number - 183 + np.array([-2.9, 0.0, 2.5]))
    east, north = Transformer.from_crs(4326, epsg, always_xy=True).transform(*np.degrees([longitude, latitude]))
    np.testing.assert_allclose(frames.to_grid(latitude, longitude, zone), [north, east], rtol=0, atol=1e-6)
    back = frames.to_geodetic(north, east, zone)
    np.testing.assert_allclose(back, [latitude, longitude], rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    "place, degrees",
    [(PAPER_III, -2.48075), ((7733885.0, 653527.0), None), ((4.0e6, 700e3), None)],
)
def test_convergence_is_the_azimuth_of_grid_north(place, degrees):
    """Geodesics along the grid line through the place; erratum E25 gives 2.48 deg west at Paper III's start."""
    gamma = frames.convergence(*frames.to_geodetic(*place, ZONE), ZONE)
    np.testing.assert_allclose(gamma, azimuth_of_grid_north(*place, 32633), rtol=0, atol=1e-9)
    if degrees is not None:
        np.testing.assert_allclose(np.degrees(gamma), degrees, rtol=0, atol=5e-6)


def test_convergence_in_tromso_used_out_of_its_zone():
    """Published (E44): +3.709 deg at Tromso in zone 33, which is really zone 34; the zone is a setting."""
    gamma = frames.convergence(*np.radians([69.6492, 18.9553]), ZONE)
    np.testing.assert_allclose(np.degrees(gamma), 3.70913, rtol=0, atol=5e-6)
    assert Zone.of(*np.radians([69.6492, 18.9553])) == Zone(34)


def test_true_heading_is_grid_heading_plus_convergence():
    """Geodesic: a ship that steers a grid heading runs the true azimuth grid heading + gamma."""
    latitude, longitude = PLACES[0]
    north, east = frames.to_grid(latitude, longitude, ZONE)
    gamma = frames.convergence(latitude, longitude, ZONE)
    for heading in np.radians([0.0, 40.0, 130.0, 250.0]):
        there = frames.to_geodetic(north + np.cos(heading), east + np.sin(heading), ZONE)
        lon, lat = np.degrees([longitude, there[1]]), np.degrees([latitude, there[0]])
        azimuth = np.radians(Geod(ellps="WGS84").inv(lon[0], lat[0], lon[1], lat[1])[0])
        np.testing.assert_allclose(np.exp(1j * azimuth), np.exp(1j * (heading + gamma)), rtol=0, atol=1e-6)


def test_missing_positions_stay_missing():
    """Law: NaN in, NaN out, the others untouched; also where nothing is known."""
    latitude, longitude = PLACES.T.copy()
    whole = frames.to_grid(latitude, longitude, ZONE)
    latitude[1] = np.nan
    for together, alone in zip(frames.to_grid(latitude, longitude, ZONE), whole, strict=True):
        np.testing.assert_array_equal(np.isnan(together), [False, True, False, False, False])
        np.testing.assert_array_equal(np.delete(together, 1), np.delete(alone, 1))
    for nothing in (np.full(3, np.nan), np.empty(0)):
        assert np.isnan(frames.convergence(nothing, nothing, ZONE)).all()
        assert np.isnan(frames.to_grid(nothing, nothing, ZONE)).all()
        assert np.isnan(frames.to_geodetic(nothing, nothing, ZONE)).all()


@pytest.mark.parametrize("text, zone", [("33N", Zone(33)), (" 56s ", Zone(56, False)), ("1N", Zone(1))])
def test_zone_reads_its_own_spelling(text, zone):
    """Round trip."""
    assert Zone.parse(text) == zone == Zone.parse(str(zone))


@pytest.mark.parametrize("text", ["", "N", "33", "0N", "61N", "33W", "33X", "-3N", "3.5N", "³N"])
def test_wrong_zone_is_one_line(text):
    """Contract: InputError, one line, with the remedy."""
    with pytest.raises(InputError, match="such as 33N") as error:
        Zone.parse(text)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    "longitude, number", [(-180.0, 1), (-174.1, 1), (-173.9, 2), (0.0, 31), (14.9, 33), (179.9, 60), (180.0, 1)]
)
def test_standard_zone(longitude, number):
    """Definition: zones of 6 degrees counted eastward from the antimeridian."""
    assert Zone.of(0.1, np.radians(longitude)) == Zone(number)
    assert Zone.of(-0.1, np.nextafter(np.radians(longitude), 10)) == Zone(number, north=False)


def test_standard_zone_just_west_of_the_antimeridian():
    """Law: every zone is one of 1 to 60, also where the modulus rounds up to 360."""
    assert 1 <= Zone.of(0.1, np.nextafter(-np.pi, -10)).number <= 60


def test_bow_to_the_east():
    """By hand (E9): at heading 90 deg forward is east and starboard is south; the printed matrix maps the bow to the west."""
    np.testing.assert_allclose(frames.to_north_east(2.0, 3.0, np.pi / 2), [-3, 2], atol=1e-15)
    np.testing.assert_allclose(frames.to_body(-3.0, 2.0, np.pi / 2), [2, 3], atol=1e-15)


def test_attitude_is_scipys_rotation():
    """scipy Rotation, intrinsic yaw-pitch-roll; also when only the yaw has a time axis."""
    yaw = np.linspace(-4, 4, 9)
    for roll, pitch in ((0.1, -0.2), (np.linspace(-0.5, 0.5, 9), 0.3)):
        angles = np.stack(np.broadcast_arrays(yaw, pitch, roll), axis=-1)
        expected = Rotation.from_euler("ZYX", angles).as_matrix()
        np.testing.assert_allclose(frames.attitude(roll, pitch, yaw), expected, atol=1e-14)


def test_attitude_without_heel_is_the_plane_rotation():
    """Law: with no roll and pitch the matrix does what `to_north_east` does."""
    for yaw in (-2.0, 0.0, 0.7, 3.0):
        np.testing.assert_allclose(
            frames.attitude(0, 0, yaw) @ [2.0, -1.0, 0.5], [*frames.to_north_east(2.0, -1.0, yaw), 0.5], atol=1e-14
        )


def test_station_motion_is_the_derivative_of_the_station_place():
    """Finite differences of an exact motion (E5, E6): velocity and inertial acceleration at an antenna off the centre."""
    place, h = (35.0, 3.6), 1e-3

    def heading(t):
        return 0.4 + 0.02 * t + 0.003 * t**2 - 1e-4 * t**3

    def centre(t):
        return np.array([3 * t + 0.05 * t**2 - 1e-3 * t**3, 5 * t - 0.02 * t**2])

    def station(t):
        return centre(t) + frames.to_north_east(*place, heading(t))

    def velocity(path, t):
        return frames.to_body(*(path(t + h) - path(t - h)) / (2 * h), heading(t))

    def acceleration(path, t):
        return frames.to_body(*(path(t + h) - 2 * path(t) + path(t - h)) / h**2, heading(t))

    t = 7.0
    r, turning = 0.02 + 0.006 * t - 3e-4 * t**2, 0.006 - 6e-4 * t
    ours = frames.station_velocity(*velocity(centre, t), r, place)
    np.testing.assert_allclose(ours, velocity(station, t), atol=1e-7)
    ours = frames.station_acceleration(*acceleration(centre, t), r, turning, place)
    np.testing.assert_allclose(ours, acceleration(station, t), atol=1e-6)
