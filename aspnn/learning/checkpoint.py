"""The checkpoint bundle: weights (safetensors), config.json, MODEL_CARD.md. Never pickle.

The config holds all that a prediction needs beside the weights: the kind and sizes of the network, the WindowSpec, the
vessel and the training domain; and where it came from.
"""

import json
import re
import shutil
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError
from safetensors.torch import load_file, save_file
from torch import nn

from aspnn.learning.corrected import CorrectedShip, CorrectedSizes
from aspnn.learning.identified import HybridGru, HybridSizes, IdentifiedShip, IdentifiedSizes
from aspnn.learning.network import RolloutEnsemble, RolloutGru, RolloutSizes, ThesisGru, ThesisSizes
from aspnn.learning.servo import Servos
from aspnn.learning.windows import WindowSpec
from aspnn.records import atomic, sha256
from aspnn.schema import InputError
from aspnn.vessel import Vessel, from_dict

FORMAT = 1
KINDS: dict[str, tuple[type, type]] = {
    "rollout": (RolloutGru, RolloutSizes),
    "ensemble": (RolloutEnsemble, RolloutSizes),
    "thesis": (ThesisGru, ThesisSizes),
    "identified": (IdentifiedShip, IdentifiedSizes),
    "hybrid": (HybridGru, HybridSizes),
    "corrected": (CorrectedShip, CorrectedSizes),
}


@dataclass(frozen=True)
class Bundle:
    """A trained network with its config. `domain` maps each input and forcing to its [lowest, highest] in training."""

    name: str
    network: nn.Module
    spec: WindowSpec
    vessel: Vessel
    region_map: bool  # whether the region-mapped pivot point or the exact step makes the path by default
    domain: dict[str, list[float]] = field(default_factory=dict)
    provenance: dict[str, Any] = field(default_factory=dict)
    calibration: dict[str, Any] | None = None  # of `aspnn calibrate`: see prediction.uncertainty
    servos: Servos | None = None  # as identified in training; None: the rudder's rate of the vessel file
    choice: dict[str, Any] | None = None  # of `aspnn choose`: see prediction.choice


def build(kind: str, sizes: dict[str, Any]) -> nn.Module:
    """A network of a kind (one of KINDS) from the plain data of its sizes. Raises InputError."""
    if kind not in KINDS:
        raise InputError(f"network kind {kind} is not known; choose among {', '.join(KINDS)}")
    module, size = KINDS[kind]
    return module(size(**{k: tuple(v) if isinstance(v, list) else v for k, v in sizes.items()}))


def write_bundle(bundle: Bundle, folder: str | Path, card: str) -> None:
    """Write the deploy bundle to `folder`; each file is whole or absent, the config comes last."""
    folder = Path(folder)
    kind = next(k for k, (module, _) in KINDS.items() if isinstance(bundle.network, module))
    with atomic(folder / "model.safetensors") as temporary:
        save_file({k: v.contiguous() for k, v in bundle.network.state_dict().items()}, temporary)
    with atomic(folder / "MODEL_CARD.md") as temporary:
        temporary.write_text(card)
    _write_config(folder, _config(bundle, kind, sha256(folder / "model.safetensors")))


def write_calibration(bundle: Bundle, source: str | Path, folder: str | Path, card: str) -> None:
    """Write the calibration of `bundle`, read from `source`, into it, or (another `folder`) into a copy of it.

    The weights are those of `source`, byte by byte; each file is whole or absent, the config comes last.
    """
    _rewrite(source, folder, card, {"calibration": bundle.calibration})


def write_choice(bundle: Bundle, source: str | Path, folder: str | Path, card: str) -> None:
    """Write the choice of `bundle`, as `write_calibration` does; a calibration of the paths without it goes."""
    _rewrite(source, folder, card, {"choice": bundle.choice, "calibration": None})


def _rewrite(source: str | Path, folder: str | Path, card: str, changes: dict[str, Any]) -> None:
    """The checkpoint `source` in `folder` with `changes` of its config; what is changed to None goes."""
    source, folder = Path(source), Path(folder)
    if folder.resolve() != source.resolve():
        with atomic(folder / "model.safetensors") as temporary:
            shutil.copyfile(source / "model.safetensors", temporary)
    with atomic(folder / "MODEL_CARD.md") as temporary:
        temporary.write_text(card)
    config = json.loads((source / "config.json").read_text()) | changes
    _write_config(folder, {key: value for key, value in config.items() if value is not None or key not in changes})


def _config(bundle: Bundle, kind: str, digest: str) -> dict[str, Any]:
    config = {
        "format": FORMAT,
        "name": bundle.name,
        "kind": kind,
        "sizes": asdict(bundle.network.sizes),  # type: ignore[call-overload]
        "spec": asdict(bundle.spec),
        "region_map": bundle.region_map,
        "domain": bundle.domain,
        "vessel": bundle.vessel.to_dict(),
        "provenance": bundle.provenance,
        "model_sha256": digest,
    }
    servos = None if bundle.servos is None else bundle.servos.to_dict()
    found = {"servo": servos, "calibration": bundle.calibration, "choice": bundle.choice}
    return config | {key: value for key, value in found.items() if value is not None}


def _write_config(folder: Path, config: dict[str, Any]) -> None:
    text = json.dumps(config, indent=1)
    # A row of numbers stands on one line: a calibration has hundreds of them.
    text = re.sub(r"\[[-+.\deE,\snul]+\]", lambda row: re.sub(r"\s+", " ", row[0]), text)
    with atomic(folder / "config.json") as temporary:
        temporary.write_text(text + "\n")


def read_bundle(folder: str | Path) -> Bundle:
    """Read a bundle. Raises InputError naming the file when it is missing, damaged or of another version."""
    folder = Path(folder)
    path = folder / "config.json"
    try:
        config = json.loads(path.read_text())
    except (FileNotFoundError, NotADirectoryError):
        raise InputError(
            f"{folder}: is no checkpoint (config.json is missing); give the folder that `aspnn train` wrote"
        ) from None
    except ValueError as error:
        raise InputError(f"{path}: not JSON ({error}); copy the checkpoint again") from None
    if config.get("format") != FORMAT:
        raise InputError(
            f"{path}: checkpoint format {config.get('format')}, this version reads {FORMAT}; train it again with this version"
        )
    weights = folder / "model.safetensors"
    if not weights.exists():
        raise InputError(f"{weights}: is missing; copy the checkpoint again")
    if sha256(weights) != config.get("model_sha256"):
        raise InputError(
            f"{weights}: does not match config.json (SHA-256); copy the checkpoint again, both files together"
        )
    try:
        network = build(config["kind"], config["sizes"])
        network.load_state_dict(load_file(weights))
        network.eval()
        torch.set_num_threads(1)  # two threads make such small networks 4 to 16 times slower
        return Bundle(
            name=config["name"],
            network=network,
            spec=WindowSpec.from_dict(config["spec"]),
            vessel=from_dict(config["vessel"], str(path)),
            region_map=config["region_map"],
            domain=config["domain"],
            provenance=config["provenance"],
            calibration=config.get("calibration"),
            servos=Servos.from_dict(config["servo"]) if "servo" in config else None,
            choice=config.get("choice"),
        )
    except (KeyError, TypeError, RuntimeError, SafetensorError) as error:
        raise InputError(
            f"{path}: is incomplete or of another version ({str(error).splitlines()[0]}); train it again"
        ) from None
