"""What goes wrong in the loop: told once, shown while it lasts, and the night goes on."""

import asyncio
import contextlib
import logging

import pytest

from aspnn.live import serve
from aspnn.live.bridge import SimulatedBridge
from aspnn.live.core import Core
from aspnn.live.server import Hub
from aspnn.live.start import settings_of
from aspnn.live.troubles import AGAIN, HOLD, Troubles, log_alarms
from aspnn.simulation.scenario import Scenario
from tests.live.test_bridge import SCENARIO


@pytest.fixture
def core():
    return Core(settings_of(SimulatedBridge(Scenario.model_validate(SCENARIO), 1.7e9)))


def test_a_loop_that_fails_goes_on(core, caplog):
    """Law: a `take` and a `look` that raise at every turn end nothing: each is logged once with its traceback; the last situation is
    published again with the alarm failed_loop, and once they work again the alarm is over after HOLD seconds."""

    async def run():
        hub, clock, troubles = Hub(core), serve.Clock(False), Troubles(core.failures)
        hub.prepared = True
        task = asyncio.create_task(serve._ticks(core, hub, clock, troubles))

        async def until(condition):
            for _ in range(500):
                if condition():
                    return
                await asyncio.sleep(0.01)
            raise AssertionError("not in time")

        await until(lambda: hub.sequence >= 1)
        look, take = core.look, core.take

        def broken(*_):
            raise ZeroDivisionError("a hull without length")

        core.look = core.take = broken
        await until(lambda: troubles.count > 8 and hub.message["alarms"][0]["code"] == "failed_loop")
        assert hub.message["alarms"][0]["severity"] == "alarm"
        assert "a hull without length" in hub.message["alarms"][0]["text"]
        failed = hub.message["sequence"]
        core.look, core.take = look, take
        await until(
            lambda: (
                any((a["code"], a["severity"]) == ("failed_loop", "warning") for a in hub.message["alarms"])
                and hub.message["sequence"] > failed
            )
        )
        troubles.settle(clock.now() + HOLD + 1)
        assert "loop" not in core.failures
        task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await task

    with caplog.at_level(logging.ERROR, "aspnn.live"):
        asyncio.run(run())
    assert len(caplog.records) == 2 and all(record.exc_info for record in caplog.records)


def test_an_alarm_is_one_line(caplog):
    """By hand: an alarm that stands is logged once; one that flickers at most once in AGAIN seconds; one that is new again is logged."""
    alarm = {"code": "gnss_lost", "severity": "alarm", "text": "position lost"}
    told: dict[str, list[float]] = {}

    def lines(moments, alarms):
        caplog.clear()
        for moment in moments:
            log_alarms(alarms, told, moment)
        return len(caplog.records)

    with caplog.at_level(logging.WARNING, "aspnn.live"):
        assert lines([0.0], [alarm]) == 0  # a blink is none
        assert lines([0.5, 1.0, 1.5, 30.0 - 26.0], [alarm]) == 1
        assert lines([10.0, 11.0, 12.0], []) == 0
        assert lines([20.0, 21.5, 23.0], [alarm]) == 0
        assert lines([23.0 + AGAIN + 1], []) == 0
        assert lines([90.0, 91.5], [alarm]) == 1
