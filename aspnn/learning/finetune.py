"""Fine-tuning: a trained network learns on from the logs of one boat, a few minutes of them.

What a short trial cannot teach is kept: the scaling of the parent's network stays as it is, rates are low and epochs few, and each
step of the optimiser draws every weight back towards the parent's, w <- w - rate x towards_parent x (w - w_parent) (L2-SP of Li,
Grandvalet and Davoine 2018, recalled, decoupled from the gradient as AdamW's decay is). Servos are identified from the new logs;
what these do not tell is the parent's.
"""

from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from aspnn.angles import compass
from aspnn.frames import to_body
from aspnn.learning.checkpoint import KINDS, Bundle, read_bundle
from aspnn.learning.config import Training
from aspnn.learning.servo import Servos
from aspnn.learning.windows import WindowSpec
from aspnn.records import States, sha256
from aspnn.schema import InputError
from aspnn.vessel import Vessel

SIZES = (
    "latent",
    "members",
    "wind",
    "dense",
)  # of a network that a training file names; the others follow from the spec


@dataclass(frozen=True)
class Parent:
    """A checkpoint that a training starts from, and the SHA-256 of its weights."""

    bundle: Bundle
    model_sha256: str

    @staticmethod
    def read(folder: str | Path) -> "Parent":
        """The parent in a checkpoint folder. Raises InputError."""
        return Parent(read_bundle(folder), sha256(Path(folder) / "model.safetensors"))

    def facts(self) -> dict[str, Any]:
        """What a checkpoint says of its parent."""
        bundle = self.bundle
        return {
            "name": bundle.name,
            "vessel": bundle.vessel.name,
            "model_sha256": self.model_sha256,
            "training_voyages": taught(bundle),
        }

    def servos(self, found: Servos | None) -> Servos | None:
        """Those `found` from the new logs; a part that they do not tell is the parent's."""
        own = self.bundle.servos
        if found is None or own is None:
            return found
        rudder = own.rudder if found.rudder.error is None else found.rudder
        return replace(found, rudder=rudder, shaft=found.shaft or own.shaft)


def taught(bundle: Bundle) -> list[str]:
    """The voyages that trained a checkpoint, and its parents."""
    return [*bundle.provenance["training_voyages"], *bundle.provenance.get("parent", {}).get("training_voyages", ())]


def check_parent(training: Training, parent: Bundle) -> None:
    """Hold a training file to the windows, kind and sizes of its parent. Raises InputError that names what differs first."""
    kind = next(name for name, (module, _) in KINDS.items() if isinstance(parent.network, module))
    net = training.network
    asked = "ensemble" if net.kind == "rollout" and net.members > 1 else net.kind
    if asked != kind:
        _refuse(training, parent, "network.kind", asked, kind)
    sizes: Any = parent.network.sizes
    for name in SIZES:
        if hasattr(net, name) and hasattr(sizes, name) and getattr(net, name) != getattr(sizes, name):
            _refuse(training, parent, f"network.{name}", getattr(net, name), getattr(sizes, name))
    spec = training.windows.spec()
    for part in fields(WindowSpec):
        own, other = getattr(spec, part.name), getattr(parent.spec, part.name)
        if own != other:
            _refuse(training, parent, f"windows.{part.name}", own, other)


def _refuse(training: Training, parent: Bundle, key: str, own: Any, other: Any) -> None:
    shown = (", ".join(map(str, value)) if isinstance(value, tuple) else value for value in (own, other))
    raise InputError(
        f"training {training.name}: {key} is {next(shown)}, that of checkpoint {parent.name} is {next(shown)}; "
        "fine-tuning keeps its parent's windows and network"
    )


def check_hull(vessel: Vessel, parent: Bundle) -> None:
    """The boat may be another, but its length and sway stations must be the parent's: the network has them in it. Raises InputError."""
    other = vessel.other_hull(parent.vessel)
    if other is not None:
        what, a, b = other
        raise InputError(
            f"vessel {vessel.name}: {what} {a:g} m, checkpoint {parent.name} was trained with {b:g} m; "
            "fine-tune a checkpoint of that hull, or train anew"
        )


def widest(a: dict[str, list[float]], b: dict[str, list[float]]) -> dict[str, list[float]]:
    """Lowest and highest of every input in either of two domains: a tuned network has been where its parent was."""
    return {name: [min(a[name][0], b[name][0]), max(a[name][1], b[name][1])] for name in a}


def from_the_water(states: States, current: np.ndarray) -> States:
    """The states as seen from water that flows steadily with `current` (2,) [m/s] towards grid north and east.

    The observer drifts with the water, so places fall behind by c t; the ship's accelerations in its own turning axes change with
    the turn, (u - c_x)' = u' - r c_y and (v - c_y)' = v' + r c_x with c_x, c_y the current ahead and athwart.
    """
    if not current.any():
        return states
    time, r = states["time_s"], states["yaw_rate_rad_s"]
    ahead, athwart = to_body(current[0], current[1], states["heading_rad"])
    table = states.table.copy()
    for name, less in (
        ("north_m", current[0] * (time - time[0])),
        ("east_m", current[1] * (time - time[0])),
        ("surge_m_s", ahead),
        ("sway_m_s", athwart),
        ("sway_bow_m_s", athwart),
        ("sway_stern_m_s", athwart),
        ("surge_acceleration_m_s2", r * athwart),
        ("sway_acceleration_m_s2", -r * ahead),
    ):
        table[name] = states[name] - less
    table["drift_rad"] = np.arctan2(-table["sway_m_s"], table["surge_m_s"])
    blowing = -states["wind_speed_true_m_s"] * np.exp(1j * states["wind_from_grid_rad"]) - complex(*current)
    table["wind_speed_true_m_s"], table["wind_from_grid_rad"] = np.abs(blowing), compass(np.angle(-blowing))
    return replace(states, table=table)
