"""The simulated ship at the pace of the clock: steps her and feeds what she says. A ship at sea needs none of it."""

import asyncio
from collections.abc import Callable

from aspnn.live.bridge import CATCH_UP, CHANNEL, SimulatedBridge
from aspnn.live.core import Core
from aspnn.live.troubles import Troubles

POLL = 0.01  # s between looks whether a step is due
PIECE = 0.5  # s of a simulated ship that are stepped at once
PAST = 35.0  # s that a simulated ship has sailed when her page opens
REST = 1.0  # s before what failed is begun anew


async def have_sailed(simulated: SimulatedBridge, core: Core, clock: Callable[[], float]) -> None:
    """Sails the simulated ship through the last PAST seconds at once: the history that a predictor needs is there from the start."""
    simulated.began = clock() - PAST
    while simulated.time + simulated.dt <= (now := clock()):
        for sent, line in simulated.advance(min(now, simulated.time + PIECE)):
            core.feed(line, sent, CHANNEL)
        core.take(simulated.time)
        await asyncio.sleep(0)


async def sail(simulated: SimulatedBridge, core: Core, clock: Callable[[], float], troubles: Troubles) -> None:
    """Steps the simulated ship at the pace of the clock and feeds what she says; after a pause in pieces, so that others have their turn."""
    while True:
        now = clock()
        behind = now - simulated.time
        try:
            for sent, line in simulated.advance(min(now, simulated.time + PIECE) if behind < CATCH_UP else now):
                core.feed(line, sent, CHANNEL)
        except Exception as error:
            troubles.happened("simulated ship", error, now)
            await asyncio.sleep(REST)
        await asyncio.sleep(POLL if behind < PIECE else 0)
