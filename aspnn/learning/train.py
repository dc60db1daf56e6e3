"""From a training file and its logs to a trained bundle: windows by voyage, scaling, the networks, provenance."""

import hashlib
import json
import math
import shutil
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import torch

from aspnn import __version__, records
from aspnn.estimation import filter_log, smooth_log
from aspnn.learning import fit
from aspnn.learning.checkpoint import Bundle
from aspnn.learning.config import RolloutNet, ThesisNet, Training
from aspnn.learning.network import RolloutEnsemble, RolloutGru, RolloutSizes, ThesisGru, ThesisSizes, flat_range
from aspnn.learning.windows import Windows, concatenate, make_windows, starts
from aspnn.records import Log
from aspnn.schema import InputError
from aspnn.vessel import Vessel


@dataclass(frozen=True)
class Material:
    """What a network learns from: training and validation windows of different voyages, and where they came from."""

    vessel: Vessel
    train: Windows
    validation: Windows | None
    facts: dict[str, Any]


def training_material(training: Training, logs: Iterable[Log]) -> Material:
    """Training and validation windows and where they came from; the last voyages validate, a voyage is never split.

    Raises InputError when a voyage is of another vessel, or when there are fewer windows than asked for.
    """
    spec, sampling = training.windows.spec(), training.windows.sampling()
    parts: dict[str, list[Windows]] = {}
    digest = hashlib.sha256()
    vessel = None
    for log in logs:
        vessel = vessel or log.vessel
        if log.vessel.name != vessel.name:
            raise InputError(
                f"{log.path or log.voyage}: vessel {log.vessel.name} among voyages of {vessel.name}; train on one vessel"
            )
        digest.update(pd.util.hash_pandas_object(log.table, index=False).to_numpy().tobytes())
        filtered, smoothed = filter_log(log), smooth_log(log)
        rows = starts(filtered, spec, sampling)
        if len(rows):
            parts.setdefault(log.voyage, []).append(make_windows(filtered, smoothed, spec, rows))
    if vessel is None or not parts:
        raise InputError(
            f"training {training.name}: no voyage has a window; it needs {spec.history:g} s before and {spec.horizon:g} s after its start"
        )
    names = list(parts)
    held = training.data.validation_voyages
    if held >= len(names):
        raise InputError(
            f"training {training.name}: {len(names)} voyages with windows, {held} of them for validation leave none to train on"
        )
    cut = len(names) - held
    limits = training.windows.train, training.windows.validation
    windows = _chosen(training, parts, names[:cut], limits[0], "train")
    validation = _chosen(training, parts, names[cut:], limits[1], "validation") if held else None
    facts = {
        "data_sha256": digest.hexdigest(),
        "training_voyages": names[:cut],
        "validation_voyages": names[cut:],
        "training_windows": len(windows),
        "validation_windows": 0 if validation is None else len(validation),
    }
    return Material(vessel, windows, validation, facts)


def _chosen(
    training: Training, parts: dict[str, list[Windows]], names: list[str], limit: int | None, what: str
) -> Windows:
    """The windows of some voyages, the first `limit` of them. Raises InputError when there are fewer."""
    windows = concatenate([part for name in names for part in parts[name]])
    if limit is None:
        return windows
    if len(windows) < limit:
        raise InputError(
            f"training {training.name}: windows.{what} asks for {limit} windows, {len(names)} voyages have {len(windows)}; "
            "add voyages"
        )
    return windows.select(np.arange(limit))


def train_bundle(training: Training, material: Material, folder: Path, quiet: bool = False) -> Bundle:
    """Train the network of a training file on its material. `folder` gets curves, logs and what a killed run needs."""
    _start_run(folder, training, material.facts)
    settings = fit.FitSettings(**training.fit.model_dump())
    windows, net = material.train, training.network
    network: ThesisGru | RolloutGru | RolloutEnsemble
    if isinstance(net, ThesisNet):
        torch.manual_seed(settings.seed)
        network = _thesis(net, windows)
        for which, name in enumerate(windows.spec.targets):
            loss, title = fit.thesis_loss(which), f"training {name}"
            fit.fit(network, loss, windows, material.validation, settings, folder / name, title, quiet)
    else:
        start, growth = net.heading_tolerance_deg
        heading = math.radians(start), math.radians(growth)
        loss = fit.path_loss(fit.Tolerance(net.position_tolerance_m, heading, net.velocity_tolerance_m_s))
        members = []
        for k in range(net.members):
            own = replace(settings, seed=settings.seed + k)
            torch.manual_seed(own.seed)
            members.append(_rollout(net, windows, material.vessel))
            name = "rollout" if k == 0 else f"rollout-{k + 1}"
            fit.fit(members[k], loss, windows, material.validation, own, folder / name, f"training {name}", quiet)
        network = members[0]
        if net.members > 1:
            network = RolloutEnsemble(members[0].sizes)
            network.members = torch.nn.ModuleList(members)
    return Bundle(
        name=training.name,
        network=network,
        spec=windows.spec,
        vessel=replace(material.vessel, simulator={}),  # the simulator's secrets are not the predictor's
        region_map=isinstance(net, ThesisNet),
        domain=_domain(windows),
        provenance={"aspnn": __version__, "torch": torch.__version__, "training": _plain(training), **material.facts},
    )


def _thesis(net: ThesisNet, windows: Windows) -> ThesisGru:
    """Paper V's networks, scaled by the extremes of the training windows, the rudder by 45 degrees (Paper V 20)."""
    spec = windows.spec
    network = ThesisGru(ThesisSizes(len(spec.inputs), spec.horizon_steps, net.latent, net.dense))
    low, high = flat_range(torch.from_numpy(windows.history))
    if "rudder_order" in spec.inputs:
        rudder, limit = spec.inputs.index("rudder_order"), math.radians(net.rudder_limit_deg)
        low[rudder], high[rudder] = -limit, limit
    network.history.set(low, high)
    network.target.set(*flat_range(torch.from_numpy(windows.target)))
    return network


def _rollout(net: RolloutNet, windows: Windows, vessel: Vessel) -> RolloutGru:
    """The roll-out GRU, scaled by two standard deviations of the training windows. Raises InputError."""
    spec = windows.spec
    missing = [name for name in spec.targets if name not in spec.inputs]
    if missing:
        raise InputError(f"windows.inputs: {missing[0]} is missing; the roll-out starts from it")
    surge, bow_sway, stern_sway = (spec.inputs.index(name) for name in spec.targets)
    now = surge, bow_sway, stern_sway
    bow, stern = vessel.sway_stations
    sizes = RolloutSizes(
        len(spec.inputs), len(spec.forcings), now, bow, stern, spec.period, net.wind, net.latent, net.members
    )
    network = RolloutGru(sizes)
    history, forcing, target, wind = (
        torch.from_numpy(getattr(windows, n)) for n in ("history", "forcing", "target", "wind")
    )
    network.history.set(*flat_range(history, 2.0))
    network.forcing.set(*flat_range(forcing, 2.0))
    network.motion.set(*flat_range(network.to_motion(target), 2.0))
    network.wind.set(*flat_range(wind, 2.0))
    return network


def _plain(training: Training) -> dict[str, Any]:
    """The training file as plain data, without the place it lies in."""
    return json.loads(training.model_dump_json(exclude={"folder"}))


def _start_run(folder: Path, training: Training, facts: dict[str, Any]) -> None:
    """Keep `folder` if it holds the same run, to be resumed; clear what training wrote there if it holds another."""
    run = json.dumps({"training": _plain(training), "data": facts["data_sha256"]}, indent=1)
    note = folder / "run.json"
    if note.exists() and note.read_text() != run:
        for old in (
            *folder.glob("rollout*"),
            *(folder / name for name in ("checkpoint", "surge", "sway_bow", "sway_stern")),
        ):
            shutil.rmtree(old, ignore_errors=True)
    with records.atomic(note) as temporary:
        temporary.write_text(run)


def _domain(windows: Windows) -> dict[str, list[float]]:
    """Lowest and highest of every input and forcing among the training windows: where the network has been."""
    spec = windows.spec
    found: dict[str, list[float]] = {}
    for names, values in ((spec.inputs, windows.history), (spec.forcings, windows.forcing)):
        for k, name in enumerate(names):
            low, high = float(values[..., k].min()), float(values[..., k].max())
            old = found.get(name, [low, high])
            found[name] = [min(low, old[0]), max(high, old[1])]
    return found
