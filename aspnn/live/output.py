"""Sentences for other systems, as UDP datagrams: VBW, and the prediction as $PASPN.

    $PASPN,hhmmss.ss,n,k,t,ddmm.mmmm,N,dddmm.mmmm,E,h.h,a.a,b.b,z.z,s*hh

Sentence k of n, one for every 10 s of the horizon: UTC of the state the prediction starts from; t [s] after it; latitude and
longitude of midship then; h true heading [deg]; a, b, z half axes [m] and true azimuth [deg] of the major one of the ellipse that
holds midship with 95 %, empty without a calibration; s status: A, or V where the predictor is outside what it was trained for or
does not fit the ship today. Without a prediction of ours nothing is sent: silence, not a guess.
"""

import math
import socket
from datetime import UTC, datetime
from typing import Any

import numpy as np

from aspnn.angles import compass
from aspnn.frames import Zone
from aspnn.live.forecast import LEVEL, Forecast, has_region
from aspnn.live.situation import degrees_of
from aspnn.logs.readings import KNOT
from aspnn.logs.sentences import encode
from aspnn.records import States

EVERY = 10.0  # s between the predicted ships told


def vbw(states: States) -> str:
    """VBW of the last of `states`: over ground surge and sway at the bow and at the stern station [kn], ahead and starboard positive.

    The water's fields are empty and flagged V: the filter knows motion over ground. While the filter coasts, all is flagged V.
    """
    now = states.table.iloc[-1]
    speeds = [float(now[name]) / KNOT for name in ("surge_m_s", "sway_bow_m_s", "sway_stern_m_s")]
    known = all(map(math.isfinite, speeds)) and not bool(now["coasting"])
    surge, bow, stern = (f"{v + 0.0:.2f}" if math.isfinite(v) else "" for v in speeds)
    status = "A" if known else "V"
    return encode("II", "VBW", ["", "", "V", surge, bow, status, "", "V", stern, status])


def prediction_sentences(forecast: Forecast, zone: Zone, epoch: float) -> list[str]:
    """The $PASPN sentences of a forecast; none where it has no path of ours. `epoch` [s, UNIX] is the zero of its time."""
    if forecast.path is None:
        return []
    marks = np.arange(EVERY, forecast.path.time[-1] + 1e-6, EVERY)
    path = forecast.path.at(marks)
    latitude, longitude = degrees_of(zone, path.north, path.east)
    heading = np.degrees(compass(path.true_heading))
    axes = [["", "", ""]] * len(marks)
    if has_region(path):
        region = path.region(LEVEL)
        azimuth = np.degrees(np.mod(region.azimuth + path.true_heading - path.heading, np.pi))
        axes = [
            [f"{a:.1f}", f"{b:.1f}", f"{z:.1f}"] for a, b, z in zip(region.major, region.minor, azimuth, strict=True)
        ]
    good = forecast.fits is not False and not forecast.outside
    moment = datetime.fromtimestamp(round(epoch + forecast.start, 2), UTC)
    clock = f"{moment:%H%M%S}.{moment.microsecond // 10_000:02d}"
    return [
        encode(
            "P",
            "ASPN",
            [
                *(clock, str(len(marks)), str(k + 1), f"{mark:.0f}"),
                *_minutes(latitude[k], 2, "NS"),
                *_minutes(longitude[k], 3, "EW"),
                f"{round(heading[k], 1) % 360:.1f}",
                *axes[k],
                "A" if good else "V",
            ],
        )
        for k, mark in enumerate(marks)
    ]


def _minutes(angle: float, digits: int, letters: str) -> list[str]:
    """Degrees and minutes to four decimals, counted in 1e-4 minutes so that none rounds up to 60, and the letter."""
    units = round(abs(angle) * 600_000)
    degrees, rest = divmod(units, 600_000)
    return [f"{degrees:0{digits}d}{rest // 10_000:02d}.{rest % 10_000:04d}", letters[1] if angle < 0 else letters[0]]


class UdpOut:
    """Sends datagrams and never waits: what the network does not take at once is dropped and counted."""

    def __init__(self, host: str, port: int) -> None:
        family, kind, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
        self.address: Any = address
        self.socket: Any = socket.socket(family, kind)
        self.socket.setblocking(False)
        self.sent = self.failed = 0
        self.error = ""

    def send(self, sentences: list[str]) -> None:
        """Each sentence as a datagram of its own. `error` says why the last one failed, empty when it went."""
        for sentence in sentences:
            try:
                self.socket.sendto(f"{sentence}\r\n".encode("ascii"), self.address)
                self.sent, self.error = self.sent + 1, ""
            except OSError as error:
                self.failed, self.error = self.failed + 1, error.strerror or str(error)

    def close(self) -> None:
        """Give the socket back."""
        self.socket.close()
