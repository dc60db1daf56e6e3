"""Sentences out: read back by the project's own strict reader, and by their definition."""

import re
import socket

import numpy as np
import pynmea2
import pytest

from aspnn.frames import to_grid
from aspnn.live.forecast import Forecaster
from aspnn.live.output import UdpOut, prediction_sentences, vbw
from aspnn.logs.readings import KNOT
from aspnn.logs.sentences import checksum
from tests.live.stand_in import ZONE, Straight, turning


def fields(sentence):
    body, _, told = sentence[1:].partition("*")
    assert f"{checksum(body):02X}" == told and len(sentence) + 2 <= 82
    return body.split(",")


def test_vbw_tells_the_dual_axis_speeds_over_ground():
    """Oracle: IEC 61162-1's order of fields as logs.readings has it: 4 and 5 over ground ahead and athwart, 9 athwart at the stern."""
    states = turning(10.0, surge=5.0, sway=0.3, rate=0.01)
    bow, stern = states.vessel.sway_stations
    said = fields(vbw(states))
    assert said[:4] == ["IIVBW", "", "", "V"]
    speeds = [float(said[k]) * KNOT for k in (4, 5, 9)]
    np.testing.assert_allclose(speeds, [5.0, 0.3 + 0.01 * bow, 0.3 + 0.01 * stern], atol=0.006 * KNOT)
    assert said[6] == said[10] == "A" and said[8] == "V"
    other = pynmea2.parse(vbw(states), check=True)  # an independent reader has the same fields
    assert (other.data_validity_grnd_spd, other.data_validity_water_spd) == ("A", "V")
    np.testing.assert_allclose(
        [float(other.lon_grnd_spd), float(other.trans_grnd_spd)], [float(said[4]), float(said[5])]
    )
    states.table["coasting"] = True
    assert fields(vbw(states))[6] == "V"


def test_paspn_tells_the_predicted_places():
    """Oracle: the path itself: 4 decimals of a minute are 0.19 m; the region is the 95 % disc of 5 m, 2.4477 x 5 m."""
    states = turning(30.0)
    forecast = Forecaster(Straight(), states.vessel).predict(states)
    sentences = prediction_sentences(forecast, ZONE, 1.7e9)
    assert len(sentences) == 9
    for k, sentence in enumerate(sentences):
        said = fields(sentence)
        assert said[0] == "PASPN" and said[1] == "221350.00" and said[2:5] == ["9", str(k + 1), f"{10 * (k + 1)}"]
        place = [(float(re.sub(r"(\d\d\.\d+)$", "", v)), float(v[-7:])) for v in (said[5], said[7])]
        latitude, longitude = (np.radians(d + m / 60) for d, m in place)
        assert said[6] == "N" and said[8] == "E"
        north, east = to_grid(latitude, longitude, ZONE)
        at = forecast.path.at([10.0 * (k + 1)])
        assert np.hypot(north - at.north[0], east - at.east[0]) < 0.2
        assert float(said[9]) == pytest.approx(np.degrees(0.01), abs=0.06)
        assert float(said[10]) == float(said[11]) == pytest.approx(5 * np.sqrt(5.991), abs=0.06)
        assert said[13] == "A"


def test_without_a_prediction_there_is_silence():
    """Law: no guess is sent in place of a prediction."""
    states = turning(30.0)
    assert prediction_sentences(Forecaster(None, states.vessel).predict(states), ZONE, 0.0) == []


def test_udp_sends_and_never_waits():
    """Law: each sentence is a datagram; an address that nobody can reach is an error that is kept, not raised."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listener:
        listener.bind(("127.0.0.1", 0))
        listener.settimeout(5)
        out = UdpOut("127.0.0.1", listener.getsockname()[1])
        out.send(["$A", "$B"])
        assert [listener.recv(100) for _ in range(2)] == [b"$A\r\n", b"$B\r\n"]
        out.close()
        out.send(["$C"])
        assert out.failed == 1 and out.error
