"""The networks. Torch only: no files, no Lightning.

Both answer one question in SI units: surge and the sway of bow and stern [m/s] from the start to the horizon, given the
history, the plan (forcing) and the wind. Scaling is part of a network: it is fitted on training windows and travels with
the weights.
"""

import math
from dataclasses import dataclass

import torch
from torch import Tensor, nn


class Affine(nn.Module):
    """x -> (x - offset) / scale per feature (last axis), fitted once on training windows."""

    offset: Tensor
    scale: Tensor

    def __init__(self, features: int):
        super().__init__()
        self.register_buffer("offset", torch.zeros(features))
        self.register_buffer("scale", torch.ones(features))

    def set(self, low: Tensor, high: Tensor) -> None:
        """Map [low, high] to [-1, 1]; a constant feature is only shifted."""
        self.offset.copy_((low + high) / 2)
        half = (high - low) / 2
        self.scale.copy_(torch.where(half > 1e-6 * high.abs().clamp(min=1e-3), half, torch.ones_like(half)))

    def forward(self, values: Tensor) -> Tensor:
        return (values - self.offset) / self.scale

    def undo(self, values: Tensor) -> Tensor:
        return values * self.scale + self.offset


def flat_range(values: Tensor, spread: float | None = None) -> tuple[Tensor, Tensor]:
    """Lowest and highest of each feature (last axis), or mean -+ `spread` standard deviations."""
    flat = values.reshape(-1, values.shape[-1])
    if spread is None:
        return flat.amin(0), flat.amax(0)
    mean, deviation = flat.mean(0), flat.std(0, correction=0)
    return mean - spread * deviation, mean + spread * deviation


@dataclass(frozen=True)
class ThesisSizes:
    """Sizes of the thesis's network (Paper V, table 6).

    Paper V gives 300 cells, which are the 300 steps of the history, and the dense layers; it does not say how wide the
    latent state is. 64 is our choice.
    """

    inputs: int
    steps: int = 900
    latent: int = 64
    dense: tuple[int, int] = (240, 120)


class ThesisGru(nn.Module):
    """Paper V's three networks (15-19, table 6): one per target, each a GRU, two dense layers (ReLU), all steps at once.

    Trained one by one on min-max scaled targets (`one`). PyTorch's gates are the same family as Paper V (15-18) with z
    and 1 - z exchanged (erratum E42). Forcing and wind are not used: the thesis's network sees the new order as the last
    row of its history, and takes it as held.
    """

    def __init__(self, sizes: ThesisSizes):
        super().__init__()
        self.sizes = sizes
        self.history = Affine(sizes.inputs)
        self.target = Affine(3)
        first, second = sizes.dense
        self.cells = nn.ModuleList(nn.GRU(sizes.inputs, sizes.latent, batch_first=True) for _ in range(3))
        self.dense = nn.ModuleList(
            nn.Sequential(
                nn.Linear(sizes.latent, first),
                nn.ReLU(),
                nn.Linear(first, second),
                nn.ReLU(),
                nn.Linear(second, sizes.steps),
            )
            for _ in range(3)
        )

    def one(self, which: int, history: Tensor) -> Tensor:
        """Scaled target number `which` (batch, steps) at the instants after the start."""
        _, last = self.cells[which](self.history(history))
        return self.dense[which](last[0])

    def forward(self, history: Tensor, forcing: Tensor, wind: Tensor) -> Tensor:
        after = self.target.undo(torch.stack([self.one(k, history) for k in range(3)], dim=-1))
        return torch.cat([after[:, :1], after], dim=1)  # the start itself is not predicted


@dataclass(frozen=True)
class RolloutSizes:
    """Sizes of the roll-out GRU: features of history and forcing, width of the latent state, geometry, step [s].

    `now` are the places of surge, bow sway and stern sway among the history's features: the start of the roll-out.
    """

    inputs: int
    forcings: int
    now: tuple[int, int, int]
    x_bow: float
    x_stern: float
    period: float
    wind: bool = False
    latent: int = 48
    members: int = 1  # of an ensemble


class RolloutGru(nn.Module):
    """A GRU that is rolled out over the plan: what it predicts is how the velocities change over each step.

    A first GRU reads the history, sets the latent state and corrects the start for the filter's error. Then, for each
    step, a GRU cell sees the velocities predicted so far, the forcing at both ends of the step and the wind turned to the
    predicted heading, and gives the change of the velocities. The future thus depends on the start through the motion
    alone, as a ship's does, and further orders inside the horizon are nothing special. Inside, motion is surge, sway
    midway between the stations and sway difference, which are less alike than the two sways.
    """

    CHANGE = 0.1  # a step of one second changes a velocity by about a tenth of its spread

    def __init__(self, sizes: RolloutSizes):
        super().__init__()
        self.sizes = sizes
        self.history = Affine(sizes.inputs)
        self.forcing = Affine(sizes.forcings)
        self.motion = Affine(3)
        self.wind = Affine(2)
        self.encoder = nn.GRU(sizes.inputs, sizes.latent, batch_first=True)
        seen = 3 + 2 * sizes.forcings + 2 * sizes.wind
        self.cell = nn.GRUCell(seen, sizes.latent)
        self.out = nn.Linear(sizes.latent, 3)
        self.direct = nn.Linear(seen, 3, bias=False)
        self.correct = nn.Linear(sizes.latent, 3)
        for layer in (self.out, self.direct, self.correct):
            nn.init.normal_(layer.weight, std=0.02)
        nn.init.zeros_(self.out.bias)
        nn.init.zeros_(self.correct.bias)

    def to_motion(self, velocities: Tensor) -> Tensor:
        """Surge, mean sway and sway difference from surge and the two sways."""
        surge, bow, stern = velocities.unbind(-1)
        return torch.stack([surge, (bow + stern) / 2, bow - stern], dim=-1)

    def to_velocities(self, motion: Tensor) -> Tensor:
        """The inverse of `to_motion`."""
        surge, mean, span = motion.unbind(-1)
        return torch.stack([surge, mean + span / 2, mean - span / 2], dim=-1)

    def forward(self, history: Tensor, forcing: Tensor, wind: Tensor) -> Tensor:
        s = self.sizes
        _, latent = self.encoder(self.history(history))
        hidden = latent[0]
        motion = self.motion(self.to_motion(history[:, -1, list(s.now)]))
        motion = motion + self.CHANGE * self.correct(hidden)
        plan, air = self.forcing(forcing), self.wind(wind)
        plan = torch.cat([plan[:, :-1], plan[:, 1:]], dim=-1)
        per_step = s.period / (s.x_bow - s.x_stern)  # turn of a step by the sway difference
        turned = torch.zeros_like(motion[:, 2])
        # Plain functions on plain tensors: calling modules would cost more than these small products do.
        gates = (self.cell.weight_ih, self.cell.weight_hh, self.cell.bias_ih, self.cell.bias_hh)
        out, bias = self.CHANGE * self.out.weight.T, self.CHANGE * self.out.bias
        direct = self.CHANGE * self.direct.weight.T
        found = [motion]
        for known in plan.unbind(dim=1):
            seen = torch.cat((motion, known), dim=-1)
            if s.wind:
                c, d = torch.cos(turned), torch.sin(turned)
                now = torch.stack([air[:, 0] * c + air[:, 1] * d, air[:, 1] * c - air[:, 0] * d], dim=-1)
                turned = turned + (motion[:, 2] * self.motion.scale[2] + self.motion.offset[2]) * per_step
                seen = torch.cat((seen, now), dim=-1)
            hidden = torch.gru_cell(seen, hidden, *gates)
            motion = torch.addmm(torch.addmm(motion + bias, hidden, out), seen, direct)
            found.append(motion)
        return self.to_velocities(self.motion.undo(torch.stack(found, dim=1)))


class RolloutEnsemble(nn.Module):
    """The mean of several roll-out GRUs that differ by their seeds alone: where recordings are few, seeds differ much."""

    def __init__(self, sizes: RolloutSizes):
        super().__init__()
        self.sizes = sizes
        self.members = nn.ModuleList(RolloutGru(sizes) for _ in range(sizes.members))

    def forward(self, history: Tensor, forcing: Tensor, wind: Tensor) -> Tensor:
        return torch.stack([member(history, forcing, wind) for member in self.members]).mean(dim=0)


def path_of(velocities: Tensor, period: float, x_bow: float, x_stern: float) -> Tensor:
    """Path (batch, steps + 1, 3) that velocities (batch, steps + 1, 3) draw from the origin: forward, starboard, turn.

    The exact rigid step of `motion.path` (E40) with each step's mean velocities, in torch for the loss on the path.
    """
    surge, bow, stern = ((velocities[:, 1:] + velocities[:, :-1]) / 2).unbind(-1)
    sway = (x_bow * stern - x_stern * bow) / (x_bow - x_stern)
    turn = (bow - stern) / (x_bow - x_stern) * period
    heading = torch.cumsum(turn, dim=1)
    middle, reach = heading - turn / 2, period * torch.sinc(turn / (2 * math.pi))
    forward = torch.cumsum((surge * torch.cos(middle) - sway * torch.sin(middle)) * reach, dim=1)
    starboard = torch.cumsum((surge * torch.sin(middle) + sway * torch.cos(middle)) * reach, dim=1)
    path = torch.stack([forward, starboard, heading], dim=-1)
    return torch.cat([torch.zeros_like(path[:, :1]), path], dim=1)
