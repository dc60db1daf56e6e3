"""Times of receipt and of rows when the program was held up: what waited was not late, and the rows' clock does not run ahead."""

import asyncio
import socket
import sys
import time
from datetime import UTC, datetime

import pytest

from aspnn.live.clocks import DRIFT, Clocks
from aspnn.live.config import UdpSource
from aspnn.live.sources import run
from aspnn.logs.recording import read_line
from aspnn.logs.sentences import encode

BEGAN = 1_700_000_000.0


def fix(at: float):
    """A GGA of that time [s, UNIX]."""
    clock = f"{datetime.fromtimestamp(at, UTC):%H%M%S.%f}"[:9]
    return read_line(
        encode("GP", "GGA", [clock, "6939.0", "N", "01857.6", "E", "1", "8", "1", "", "M", "", "M", "", ""]).encode()
    )[0]


def test_sentences_that_come_sooner_than_at_first_move_the_clock_no_faster_than_clocks_drift():
    """Law: the first fixes of a busy start come 0.4 s late, the others at once: the rows' clock stays within DRIFT of that of receipt,
    so that no later sentence counts as late."""
    clocks = Clocks()
    for k in range(600):
        at = BEGAN + k / 10
        received = at + (0.4 if k < 20 else 0.02)
        assert clocks.place(fix(at), received, "bus") == pytest.approx(at, abs=0.011)
        assert abs(clocks.ahead) <= DRIFT * (k / 10 + 3)


@pytest.mark.skipif(sys.platform != "linux", reason="the system tells no times of arrival")
def test_datagrams_that_waited_are_received_when_they_came():
    """Law: a loop that was held up for 0.6 s after a datagram came takes it as of when it came, by the system's own stamp."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        out.bind(("127.0.0.1", 0))
        port = out.getsockname()[1]

    async def main():
        heard = []
        source = UdpSource(kind="udp", port=port, host="127.0.0.1")
        task = asyncio.create_task(run(source, lambda *said: heard.append(said), print, time.time))
        await asyncio.sleep(0.05)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
            for text in (b"$A\r\n", b"$B\r\n"):
                out.sendto(text, ("127.0.0.1", port))
        sent = time.time()
        time.sleep(0.6)  # the loop is held up
        while len(heard) < 2:
            await asyncio.sleep(0.01)
        task.cancel()
        return sent, heard

    sent, heard = asyncio.run(main())
    assert [text for text, _, _ in heard] == ["$A\r\n", "$B\r\n"]
    assert all(received <= sent + 0.3 for _, received, _ in heard)
