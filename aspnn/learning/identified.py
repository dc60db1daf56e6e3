"""An identified ship: accelerations as polynomials of speed and rudder, fitted to logs; and the GRU that learns its residual.

The polynomial stands for hull, propeller and rudder in the manner of Abkowitz (1964) and of the second-order modulus
models: every force is of second degree in the speeds of hull, propeller and air, so that a slow ship stays a slow ship,
times a cubic polynomial of the rudder angle. Nothing is assumed to be alike to port and starboard.
"""

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from aspnn.learning.network import Affine

PAIRS = ("uu", "uv", "ur", "vv", "vr", "rr", "vV", "vR", "rV", "rR", "uV", "uR")  # capitals are absolute values
TRIPLES = ("vvv", "vvr", "vrr", "rrr")  # over the root of 1 + u2 + v2 + r2, so of second degree at speed
_PLACE = {name: k for k, name in enumerate("uvrUVR")}
_FIRST, _SECOND = ([_PLACE[pair[k]] for pair in PAIRS] for k in (0, 1))
_SQUARE, _THIRD = [PAIRS.index(t[:2]) for t in TRIPLES], [_PLACE[t[2]] for t in TRIPLES]
HULL = 1 + 3 + len(PAIRS) + len(TRIPLES)  # terms in the hull's motion, of degree 0, 1, 2 and 2
RUDDER = 4  # powers of the rudder angle, from none
AIR = 5  # terms in the apparent wind
LIMIT = 2.0  # of the ship's speed at least: beyond it forces grow no more, so that no roll-out ends in infinity
BEYOND = 1.5  # of the largest motion in training: so far it reaches where some voyages are much faster than most
GAINS = (1.0, 0.6, 0.35, 0.2, 0.12, 0.07, 0.04)  # of the observer, to begin with


@dataclass(frozen=True)
class IdentifiedSizes:
    """Geometry and step [s] of an identified ship, and where its quantities stand.

    `forcing` are the columns of rudder angle and, where it is known, shaft speed among the forcings, `driven` the same
    among the history's features, `now` those of surge, bow sway and stern sway. An unknown shaft speed is taken as held.
    """

    forcing: tuple[int, ...]
    driven: tuple[int, ...]
    now: tuple[int, int, int]
    x_bow: float
    x_stern: float
    period: float
    wind: bool = False


class IdentifiedShip(nn.Module):
    """du/dt, dv/dt, dr/dt as polynomials of u, v, r, rudder angle, shaft speed n and wind; rolled out by Runge-Kutta.

    With speeds in units of `speed` and half the sway difference for r,
    x' = sum_jk W_jk h_j(x) n_j d^k + sum_j A_j a_j(w - x): h_j are 1, the speeds, PAIRS and TRIPLES; n_j is n2, n or 1 so
    that each term is of second degree (n = 1 where the shaft speed is not known), with terms in |n| beside them, since a
    reversed propeller is another propeller; d is the rudder angle over its largest in training; a_j are the quadratic
    terms of the apparent wind. `whiten` turns the weights that are learned into W: terms as they occur in training are
    then uncorrelated and of unit size, without which neither ridge nor gradient descent finds its way.

    The start is not the last filtered state but that of an observer: the ship sails through the history and is drawn to
    each filtered state by a constant `gain` (1: the filtered state itself), since what a filter takes for sway a hull
    could often not have done.
    """

    speed: Tensor
    largest: Tensor
    whiten: Tensor
    limit: Tensor

    def __init__(self, sizes: IdentifiedSizes):
        super().__init__()
        self.sizes = sizes
        self.shaft = len(sizes.forcing) > 1
        self.terms = HULL * RUDDER + (4 * RUDDER if self.shaft else 0) + (AIR if sizes.wind else 0)
        self.register_buffer("speed", torch.ones(()))
        self.register_buffer("largest", torch.ones(2))  # rudder angle [rad], shaft speed [rev/s]
        self.register_buffer("limit", torch.tensor(LIMIT))
        self.register_buffer("whiten", torch.eye(self.terms))
        self.weight = nn.Parameter(torch.zeros(self.terms, 3))
        self.gain = nn.Parameter(torch.eye(3))

    def to_motion(self, velocities: Tensor) -> Tensor:
        """Surge, sway at midship and half the sway difference, in units of `speed`, of surge and the two sways."""
        s = self.sizes
        surge, bow, stern = velocities.unbind(-1)
        sway = (s.x_bow * stern - s.x_stern * bow) / (s.x_bow - s.x_stern)
        return torch.stack([surge, sway, (bow - stern) / 2], dim=-1) / self.speed

    def to_velocities(self, motion: Tensor) -> Tensor:
        """The inverse of `to_motion`."""
        s = self.sizes
        surge, sway, half = (motion * self.speed).unbind(-1)
        rate = 2 * half / (s.x_bow - s.x_stern)
        return torch.stack([surge, sway + s.x_bow * rate, sway + s.x_stern * rate], dim=-1)

    def plan(self, driven: Tensor) -> tuple[Tensor, Tensor]:
        """Powers (..., RUDDER) of the rudder angle and the shaft speed (...), over their largest in training.

        `driven` (..., 1 or 2) are rudder angle [rad] and, where it is known, shaft speed [rev/s].
        """
        rudder = driven[..., 0] / self.largest[0]
        powers = torch.stack([torch.ones_like(rudder), rudder, rudder**2, rudder**3], dim=-1)
        return powers, driven[..., 1] / self.largest[1] if self.shaft else torch.ones_like(rudder)

    def coefficients(self, powers: Tensor, shaft: Tensor) -> Tensor:
        """What multiplies the hull's terms under a plan: (..., 3, HULL)."""
        weight = self.whiten @ self.weight
        hull = weight[: HULL * RUDDER].reshape(HULL, RUDDER, 3)
        found = torch.einsum("...k,jkc->...jc", powers, hull)
        n = shaft[..., None, None]
        parts = [found[..., :1, :] * n * n, found[..., 1:4, :] * n, found[..., 4:, :]]
        if self.shaft:
            reverse = weight[HULL * RUDDER : (HULL + 4) * RUDDER].reshape(4, RUDDER, 3)
            beside = torch.einsum("...k,jkc->...jc", powers, reverse) * n.abs()
            parts[0], parts[1] = parts[0] + beside[..., :1, :] * n, parts[1] + beside[..., 1:, :]
        return torch.cat(parts, dim=-2).transpose(-1, -2).contiguous()

    def rate(self, motion: Tensor, coefficients: Tensor, air: Tensor | None) -> Tensor:
        """Change of the motion per second (batch, 3); `air` is the velocity of the air in body axes, over `speed`."""
        motion = motion.clamp(-self.limit, self.limit)
        found = (hull_terms(motion)[..., None, :] * coefficients).sum(-1)  # a batch of small matrix products is slower
        if air is not None:
            found = found + air_terms(air - motion[..., :2]) @ (self.whiten @ self.weight)[-AIR:]
        return found

    def step(self, motion: Tensor, known: tuple[Tensor, Tensor, Tensor], air: Tensor | None) -> Tensor:
        """The motion one period later, by the classic Runge-Kutta step.

        `known` are the coefficients at the beginning, middle and end of the step. `air` [over `speed`] is given in axes
        of the step's beginning and turned with the hull at the yaw rate that it has there.
        """
        h = self.sizes.period
        begin, middle, end = known
        halfway = later = air
        if air is not None:
            turn = self.turn(motion)
            halfway, later = turned(air, turn / 2), turned(air, turn)
        k1 = self.rate(motion, begin, air)
        k2 = self.rate(motion + h / 2 * k1, middle, halfway)
        k3 = self.rate(motion + h / 2 * k2, middle, halfway)
        k4 = self.rate(motion + h * k3, end, later)
        return motion + h / 6 * (k1 + 2 * (k2 + k3) + k4)

    def turn(self, motion: Tensor) -> Tensor:
        """Heading change of one period [rad] at the yaw rate of `motion`."""
        s = self.sizes
        return motion[..., 2] * self.speed * (2 * s.period / (s.x_bow - s.x_stern))

    def steps(self, driven: Tensor) -> list[tuple[Tensor, Tensor, Tensor]]:
        """`known` of every step under `driven` (batch, steps + 1, 1 or 2; see `plan`), linear between its instants."""
        middle = (driven[:, 1:] + driven[:, :-1]) / 2
        at, between = (self.coefficients(*self.plan(part)).unbind(1) for part in (driven, middle))
        return list(zip(at[:-1], between, at[1:], strict=True))

    def observe(self, history: Tensor, air: Tensor | None) -> Tensor:
        """The motion at the start (batch, 3), by the observer; `air` is the wind at the start, taken as steady before."""
        seen = self.to_motion(history[..., list(self.sizes.now)])
        turns = self.turn(seen)
        back = torch.flip(torch.cumsum(torch.flip((turns[:, 1:] + turns[:, :-1]) / 2, [1]), 1), [1])
        motion, instants = seen[:, 0], seen.unbind(1)[1:]
        for k, known in enumerate(self.steps(history[..., list(self.sizes.driven)])):
            expected = self.step(motion, known, None if air is None else turned(air, -back[:, k]))
            motion = torch.addmm(expected, instants[k] - expected, self.gain.T)
        return motion

    def forward(self, history: Tensor, forcing: Tensor, wind: Tensor) -> Tensor:
        air = wind / self.speed if self.sizes.wind else None
        motion = self.observe(history, air)
        found = [motion]
        for known in self.steps(forcing[..., list(self.sizes.forcing)]):
            after = self.step(motion, known, air)
            if air is not None:
                air = turned(air, (self.turn(motion) + self.turn(after)) / 2)
            motion = after
            found.append(motion)
        return self.to_velocities(torch.stack(found, dim=1))

    def library(self, target: Tensor, forcing: Tensor, wind: Tensor, turn: Tensor) -> Tensor:
        """Every term at every instant (batch, steps + 1, terms), before whitening; `turn` [rad] is since the start."""
        motion = self.to_motion(target)
        powers, shaft = self.plan(forcing[..., list(self.sizes.forcing)])
        n, hull = shaft[..., None], hull_terms(motion)
        parts = [(torch.cat([hull[..., :1] * n * n, hull[..., 1:4] * n, hull[..., 4:]], -1), powers)]
        if self.shaft:
            parts.append((torch.cat([hull[..., :1] * n * n.abs(), hull[..., 1:4] * n.abs()], -1), powers))
        columns = [(a[..., :, None] * b[..., None, :]).flatten(-2) for a, b in parts]
        if self.sizes.wind:
            air = turned((wind / self.speed)[:, None].expand(*turn.shape, 2), turn)
            columns.append(air_terms(air - motion[..., :2]))
        return torch.cat(columns, dim=-1)

    @torch.no_grad()
    def regress(self, target: Tensor, forcing: Tensor, wind: Tensor, turn: Tensor, ridge: float) -> None:
        """Scale, whiten and set the weights by ridge regression on smoothed motion: (batch, steps + 1, ...) as in Windows.

        Not derivatives but their integrals over two steps are matched, by Simpson's rule: what a smoother leaves of
        noise is not differentiated, and the error of the rule is of fourth order in the step. `ridge` counts against
        terms of unit size.
        """
        self.speed.copy_(target[..., 0].square().mean().sqrt())
        self.limit.copy_((BEYOND * self.to_motion(target).abs().max()).clamp(min=LIMIT))
        driven = forcing[..., list(self.sizes.forcing)].flatten(0, -2).abs().amax(0)
        self.largest[: len(driven)] = torch.where(driven > 0, driven, torch.ones_like(driven))
        gram = torch.zeros(self.terms, self.terms, dtype=torch.double)
        moment, spread, count = torch.zeros(self.terms, 3, dtype=torch.double), torch.zeros((), dtype=torch.double), 0
        for part in torch.arange(len(target)).split(256):  # all at once would take gigabytes
            some, *others = (array[part].double() for array in (target, forcing, wind, turn))
            motion, terms = self.to_motion(some), self.library(some, *others)
            mean = ((terms[:, :-2] + 4 * terms[:, 1:-1] + terms[:, 2:]) / 6).flatten(0, 1)
            change = ((motion[:, 2:] - motion[:, :-2]) / (2 * self.sizes.period)).flatten(0, 1)
            gram, moment, count = gram + mean.T @ mean, moment + mean.T @ change, count + len(mean)
            spread = spread + change.square().sum()
        # Principal axes of the terms scaled to unit size; an axis that the voyages hardly excite is damped by the ridge,
        # not blown up to unit size: its weight stays as small as what is known of it.
        size = (gram.diagonal() / count).sqrt()
        size = torch.where(size > 0, size, torch.ones_like(size))
        values, axes = torch.linalg.eigh(gram / count / size / size[:, None])
        unit = (spread / count).sqrt()  # weights of unit size are accelerations of usual size
        whiten = unit * axes / size[:, None] / (values.clamp(min=0) + ridge).sqrt()
        self.whiten.copy_(whiten)
        white = whiten.T @ gram @ whiten / count
        damped = white + unit**2 * torch.diag(ridge / (values.clamp(min=0) + ridge))
        self.weight.copy_(torch.linalg.solve(damped, whiten.T @ moment / count))

    @torch.no_grad()
    def settle(self, history: Tensor, target: Tensor, wind: Tensor) -> None:
        """Set the observer's gain, axis by axis, to the one of GAINS whose starts come closest to the smoothed ones.

        A few hundred starts decide; each axis counts against the filter's own error there.
        """
        some = torch.arange(0, len(target), max(1, len(target) // 300))
        history, start = history[some], self.to_motion(target[some, 0])
        air = wind[some] / self.speed if self.sizes.wind else None
        size = (self.to_motion(history[:, -1, list(self.sizes.now)]) - start).square().mean(0)
        if not (size > 0).all():
            return  # starts without error: the filtered state is the best there is

        def error(gain: float, axis: int) -> float:
            self.gain[axis, axis] = gain
            return float(((self.observe(history, air) - start).square().mean(0) / size).sum())

        for axis in range(3):
            errors = [error(gain, axis) for gain in GAINS]
            self.gain[axis, axis] = GAINS[errors.index(min(errors))]


def hull_terms(motion: Tensor) -> Tensor:
    """1, the speeds, PAIRS, and TRIPLES over the root of 1 + u2 + v2 + r2, of a motion (..., 3): (..., HULL)."""
    both = torch.cat([motion, motion.abs()], dim=-1)
    pairs = both[..., _FIRST] * both[..., _SECOND]
    whole = torch.rsqrt(1 + motion.square().sum(dim=-1, keepdim=True))
    return torch.cat([torch.ones_like(whole), motion, pairs, pairs[..., _SQUARE] * motion[..., _THIRD] * whole], dim=-1)


def air_terms(apparent: Tensor) -> Tensor:
    """Quadratic terms of the apparent wind, velocity of the air (..., 2) forward and to starboard: (..., AIR)."""
    ahead, across = apparent.unbind(-1)
    sides = ahead * ahead.abs(), across * across.abs()
    return torch.stack([ahead * ahead, sides[0], ahead * across, across * across, sides[1]], dim=-1)


def turned(air: Tensor, angle: Tensor) -> Tensor:
    """A velocity (..., 2) forward and to starboard in axes turned by `angle` [rad] to starboard."""
    c, s = torch.cos(angle), torch.sin(angle)
    return torch.stack([air[..., 0] * c + air[..., 1] * s, air[..., 1] * c - air[..., 0] * s], dim=-1)


@dataclass(frozen=True)
class HybridSizes:
    """Sizes of the hybrid: those of its ship (see IdentifiedSizes), features of history and forcing, width of the GRU."""

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

    def ship(self) -> IdentifiedSizes:
        """The sizes of its identified ship."""
        return IdentifiedSizes(self.forcing, self.driven, self.now, self.x_bow, self.x_stern, self.period, self.wind)


class HybridGru(nn.Module):
    """An identified ship whose start and whose every step a GRU corrects.

    The history's GRU corrects the observed start and says what the ship's motion does not; a GRU cell then
    adds to each step of the ship what it has learned that the ship leaves over. Untrained, it is the ship.

    To be taken where hours of voyages cover a ship's orders (cargo90): trained through the ship, it keeps its best on steady
    courses and in the tail after orders. Where recordings are few or trainings many, take a corrected ship
    (learning.corrected).
    """

    START, CHANGE = 0.01, 0.002  # of the ship's speed: a start's error, and a second's left-over change

    def __init__(self, sizes: HybridSizes):
        super().__init__()
        self.sizes = sizes
        self.ship = IdentifiedShip(sizes.ship())
        self.history = Affine(sizes.inputs)
        self.forcing = Affine(sizes.forcings)
        self.motion = Affine(3)
        self.wind = Affine(2)
        self.encoder = nn.GRU(sizes.inputs, sizes.latent, batch_first=True)
        self.cell = nn.GRUCell(3 + 2 * sizes.forcings + 2 * sizes.wind, sizes.latent)
        self.out = nn.Linear(sizes.latent, 3)
        self.correct = nn.Linear(sizes.latent, 3)
        for layer in (self.out, self.correct):
            nn.init.zeros_(layer.weight)
            nn.init.zeros_(layer.bias)

    def forward(self, history: Tensor, forcing: Tensor, wind: Tensor) -> Tensor:
        ship, sizes = self.ship, self.sizes
        hidden = self.encoder(self.history(history))[1][0]
        air = wind / ship.speed if sizes.wind else None
        motion = ship.observe(history, air) + self.START * self.correct(hidden)
        plan = self.forcing(forcing)
        plan = torch.cat([plan[:, :-1], plan[:, 1:]], dim=-1)
        gates = (self.cell.weight_ih, self.cell.weight_hh, self.cell.bias_ih, self.cell.bias_hh)
        per_step = self.CHANGE * sizes.period
        out, bias = per_step * self.out.weight.T, per_step * self.out.bias
        found = [motion]
        for known, ordered in zip(ship.steps(forcing[..., list(sizes.forcing)]), plan.unbind(1), strict=True):
            seen = torch.cat((self.motion(motion), ordered), dim=-1)
            if air is not None:
                seen = torch.cat((seen, self.wind(air * ship.speed)), dim=-1)
            hidden = torch.gru_cell(seen, hidden, *gates)
            after = torch.addmm(ship.step(motion, known, air) + bias, hidden, out)
            if air is not None:
                air = turned(air, (ship.turn(motion) + ship.turn(after)) / 2)
            motion = after
            found.append(motion)
        return ship.to_velocities(torch.stack(found, dim=1))
