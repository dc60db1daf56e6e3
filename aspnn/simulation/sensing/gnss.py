"""GNSS receivers: wander, spikes, jumps, frozen fixes and outages, per antenna.

White noise and delay are those of `Sensors`; here is what makes real fixes worse than that. Everything is off by default.
"""

from typing import Annotated, NamedTuple

import numpy as np
from pydantic import AfterValidator, ConfigDict, Field
from pydantic.dataclasses import dataclass

from aspnn.simulation.sensing.errors import gauss_markov, spells

NotNegative = Annotated[float, Field(ge=0)]
Positive = Annotated[float, Field(gt=0)]
Share = Annotated[float, Field(ge=0, lt=1)]


def _rising(pair: tuple[float, float]) -> tuple[float, float]:
    if not 0 <= pair[0] <= pair[1]:
        raise ValueError(f"from {pair[0]:g} to {pair[1]:g}: both must be 0 or more, the lower end first")
    return pair


Rising = Annotated[tuple[float, float], AfterValidator(_rising)]


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class Gnss:
    """What receivers do wrong, the section `[sensors.gnss]` of a scenario. Spells take up a share of the time and last a mean time.

    Spells and spikes befall each antenna by itself; `outages_s`, windows [from, to] in seconds, befall all. Sizes of jumps are
    uniform in `jump_m`, their directions anyhow.
    """

    wander_m: NotNegative = 0.0  # stationary deviation of each of north and east; paper 000: 4.7 (E60)
    wander_time_s: Positive = 1100.0  # correlation time; paper 000
    wander_common: bool = True  # one wander for all antennas, as orbits and ionosphere make it; else each its own
    spike_share: Share = 0.0  # of single fixes that are off
    jump_share: Share = 0.0  # of the time in spells through which fixes are off by the same amount
    jump_s: Positive = 20.0
    jump_m: Rising = (10.0, 50.0)
    frozen_share: Share = 0.0  # of the time through which the last fix is repeated
    frozen_s: Positive = 3.0
    outage_share: Share = 0.0
    outage_s: Positive = 30.0
    outages_s: tuple[Rising, ...] = ()
    height_m: NotNegative | None = None  # white deviation of the height; left out: no height is recorded
    height_wander_m: NotNegative = 0.0
    sea_level_m: float = 0.0  # height of the still water above the ellipsoid


class Receiver(NamedTuple):
    """The errors of one antenna over all steps: `offset` (3, steps) north, east, up [m]; where it is `frozen`, where `out`."""

    offset: np.ndarray
    frozen: np.ndarray
    out: np.ndarray

    def tell(self, values: np.ndarray, sampled: np.ndarray) -> np.ndarray:
        """What it records of `values` (..., steps) at the steps `sampled`: nothing in an outage, the last one while frozen."""
        own = np.where(sampled & ~self.frozen, np.arange(len(sampled)), -1)
        last = np.maximum.accumulate(own)
        last[last < 0] = np.argmax(sampled)  # frozen from the start: the first is repeated
        return np.where(self.out | ~sampled, np.nan, values[..., last])


def receivers(gnss: Gnss, time: np.ndarray, antennas: int, rng: np.random.Generator) -> list[Receiver]:
    """The errors of each of `antennas` receivers at `time` [s], even steps. Each kind of error has a stream of its own."""
    dt = float(time[1] - time[0])
    common, *own = rng.spawn(1 + antennas)
    shared = _wander(gnss, common, len(time), dt)
    return [_receiver(gnss, time, stream, shared) for stream in own]


def _receiver(gnss: Gnss, time: np.ndarray, rng: np.random.Generator, shared: np.ndarray) -> Receiver:
    wander, spikes, jumps, frozen, outage = rng.spawn(5)
    offset = shared if gnss.wander_common else _wander(gnss, wander, len(time), float(time[1] - time[0]))
    if gnss.spike_share:
        offset = offset + _jumps(gnss, spikes, len(time)) * (spikes.random(len(time)) < gnss.spike_share)
    if gnss.jump_share:
        spell = spells(jumps, time, gnss.jump_share, gnss.jump_s)
        offset = offset + _jumps(gnss, jumps, int(spell.max()) + 1)[:, spell] * (spell > 0)
    out = spells(outage, time, gnss.outage_share, gnss.outage_s) > 0
    for begin, end in gnss.outages_s:
        out |= (time >= begin) & (time <= end)
    return Receiver(offset, spells(frozen, time, gnss.frozen_share, gnss.frozen_s) > 0, out)


def _wander(gnss: Gnss, rng: np.random.Generator, steps: int, dt: float) -> np.ndarray:
    deviation = np.array([[gnss.wander_m], [gnss.wander_m], [gnss.height_wander_m]])
    return gauss_markov(rng, (3, steps), dt, deviation, gnss.wander_time_s)


def _jumps(gnss: Gnss, rng: np.random.Generator, count: int) -> np.ndarray:
    """Horizontal displacements (3, count) [m]."""
    size, towards = rng.uniform(*gnss.jump_m, count), rng.uniform(0.0, 2 * np.pi, count)
    return np.stack([size * np.cos(towards), size * np.sin(towards), np.zeros(count)])
