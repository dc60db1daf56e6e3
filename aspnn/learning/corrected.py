"""An identified ship, and GRUs that learn what its roll-outs leave over. Torch only.

Where recordings are few or trainings many (Esso Osaka, by cross-validation), this is quick and holds: the ship carries what
physics knows to orders and speeds that were hardly recorded, and the GRUs learn from its finished roll-outs, one pass over a
sequence, without training through the ship. Where hours of voyages leave decimetres of error (cargo90), take the hybrid
(learning.identified), which starts as its ship and corrects each step by what came of the last; untrained, a correction is
of the size of a model ship's errors, and takes long to become smaller.
"""

from dataclasses import asdict, dataclass

import torch
from torch import Tensor, nn

from aspnn.learning.identified import IdentifiedShip, IdentifiedSizes, turned
from aspnn.learning.network import Affine, flat_range


@dataclass(frozen=True)
class CorrectedSizes:
    """Sizes of a corrected ship: those of its ship (see IdentifiedSizes), features of history and forcing, width and number of GRUs."""

    inputs: int
    forcings: int
    forcing: tuple[int, ...]
    driven: tuple[int, ...]
    now: tuple[int, int, int]
    x_bow: float
    x_stern: float
    period: float
    wind: bool = False
    latent: int = 24
    members: int = 1

    def ship(self) -> IdentifiedSizes:
        """The sizes of its identified ship."""
        return IdentifiedSizes(self.forcing, self.driven, self.now, self.x_bow, self.x_stern, self.period, self.wind)


class Correction(nn.Module):
    """What a ship's roll-out leaves over, by a GRU that reads the history, then another that reads the roll-out.

    The error of the velocities is that of the start, said by the history, plus a sum of what each step adds, said by the
    ship's own motion, the plan and the wind there: all known before the GRU begins, so that it runs as one sequence.
    """

    CHANGE = 0.05  # of the ship's speed: a start's error, and a second's left-over change

    def __init__(self, sizes: CorrectedSizes):
        super().__init__()
        self.sizes = sizes
        self.history = Affine(sizes.inputs)
        self.rolled = Affine(3 + 2 * sizes.wind)
        self.forcing = Affine(sizes.forcings)
        self.encoder = nn.GRU(sizes.inputs + 2 * sizes.wind, sizes.latent, batch_first=True)
        self.cell = nn.GRU(3 + 2 * sizes.wind + 2 * sizes.forcings, sizes.latent, batch_first=True)
        self.out = nn.Linear(sizes.latent, 3)
        self.correct = nn.Linear(sizes.latent, 3)
        for layer in (self.out, self.correct):
            nn.init.normal_(layer.weight, std=0.01)
            nn.init.zeros_(layer.bias)

    def forward(self, history: Tensor, rolled: Tensor, forcing: Tensor) -> Tensor:
        """Error (batch, steps + 1, 3) of surge, mean sway and half the sway difference, over the ship's speed."""
        past, seen, plan = self.history(history), self.rolled(rolled), self.forcing(forcing)
        if self.sizes.wind:  # in axes of the start, as the history's end
            past = torch.cat([past, seen[:, :1, 3:].expand(-1, past.shape[1], 2)], dim=-1)
        hidden = self.encoder(past)[1]
        start = self.correct(hidden[0])[:, None]
        steps, _ = self.cell(torch.cat([seen[:, :-1], plan[:, :-1], plan[:, 1:]], dim=-1), hidden)
        later = start + self.sizes.period * torch.cumsum(self.out(steps), dim=1)
        return self.CHANGE * torch.cat([start, later], dim=1)


class CorrectedShip(nn.Module):
    """The roll-out of an identified ship plus the mean of its corrections, which differ by their seeds alone."""

    def __init__(self, sizes: CorrectedSizes):
        super().__init__()
        self.sizes = sizes
        self.ship = IdentifiedShip(sizes.ship())
        self.members = nn.ModuleList(Correction(sizes) for _ in range(sizes.members))

    def roll(self, history: Tensor, forcing: Tensor, wind: Tensor) -> Tensor:
        """The ship's roll-out (batch, steps + 1, 3), over its speed, and where wind is used the air in body axes [m/s] then."""
        motion = self.ship.to_motion(self.ship(history, forcing, wind))
        if not self.sizes.wind:
            return motion
        turn = self.ship.turn((motion[:, 1:] + motion[:, :-1]) / 2)
        turn = torch.cat([torch.zeros_like(turn[:, :1]), torch.cumsum(turn, dim=1)], dim=1)
        return torch.cat([motion, turned(wind[:, None].expand(-1, turn.shape[1], 2), turn)], dim=-1)

    def forward(self, history: Tensor, forcing: Tensor, wind: Tensor) -> Tensor:
        rolled = self.roll(history, forcing, wind)
        errors = torch.stack([member(history, rolled, forcing) for member in self.members]).mean(dim=0)
        return self.ship.to_velocities(rolled[..., :3] + errors)

    @torch.no_grad()
    def scale(self, history: Tensor, rolled: Tensor, forcing: Tensor) -> None:
        """Scale what the corrections see by two standard deviations of training."""
        for member in self.members:
            assert isinstance(member, Correction)
            for place, values in ((member.history, history), (member.rolled, rolled), (member.forcing, forcing)):
                place.set(*flat_range(values, 2.0))


class Taught(nn.Module):
    """One correction as it is trained: its forcing carries the roll-out of the ship, which is not computed again.

    `forcing` (batch, steps + 1, forcings + 3 or 5): that of the windows, then `CorrectedShip.roll`.
    """

    def __init__(self, whole: CorrectedShip, member: Correction):
        super().__init__()
        self.member = member
        self.sizes = whole.sizes
        self.ship = [whole.ship]  # in a list: it is no part of what is trained

    def forward(self, history: Tensor, forcing: Tensor, wind: Tensor) -> Tensor:
        forcing, rolled = forcing[..., : self.sizes.forcings], forcing[..., self.sizes.forcings :]
        return self.ship[0].to_velocities(rolled[..., :3] + self.member(history, rolled, forcing))


def corrected(ship: IdentifiedShip, inputs: int, forcings: int, latent: int, members: int) -> CorrectedShip:
    """A corrected ship about a trained `ship`, its corrections untrained."""
    whole = CorrectedShip(CorrectedSizes(inputs, forcings, **asdict(ship.sizes), latent=latent, members=members))
    whole.ship.load_state_dict(ship.state_dict())
    whole.ship.requires_grad_(False)
    return whole
