"""From a training file and its logs to a trained bundle: windows by voyage, scaling, the networks, provenance."""

import copy
import hashlib
import json
import math
import shutil
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Any, cast

import numpy as np
import pandas as pd
import torch

from aspnn import __version__, records
from aspnn.estimation import filter_log, smooth_log
from aspnn.estimation.course import filter_course
from aspnn.estimation.spatial import filter_spatial
from aspnn.learning import fit, stream
from aspnn.learning.checkpoint import Bundle
from aspnn.learning.config import CorrectedNet, HybridNet, IdentifiedNet, RolloutNet, ThesisNet, Training
from aspnn.learning.corrected import CorrectedShip, Correction, Taught, corrected
from aspnn.learning.features import WIND
from aspnn.learning.finetune import Parent, check_hull, check_parent, from_the_water, widest
from aspnn.learning.identified import HybridGru, HybridSizes, IdentifiedShip, IdentifiedSizes
from aspnn.learning.identify_servo import identify_servos
from aspnn.learning.network import RolloutEnsemble, RolloutGru, RolloutSizes, ThesisGru, ThesisSizes, flat_range
from aspnn.learning.servo import Servos
from aspnn.learning.windows import Sampling, Windows, WindowSpec, concatenate, make_windows, starts
from aspnn.records import Log, States
from aspnn.schema import InputError
from aspnn.vessel import Vessel

SERVO_HOURS = 5.0  # of training voyages that servos are identified from


class RunsAway(InputError):
    """An identified ship whose roll-outs leave the motions that it knows: its ridge is too small."""


@dataclass(frozen=True)
class Material:
    """What a network learns from: training and validation windows of different voyages, and where they came from."""

    vessel: Vessel
    train: Windows
    validation: Windows | None
    facts: dict[str, Any]
    servos: Servos | None = None  # by which the windows' forcings follow their plans; None: as the vessel file has it


Flow = Callable[[States], np.ndarray]  # the steady current (2,) [m/s] of a voyage, zero where none is known


def training_material(
    training: Training,
    logs: Iterable[Log],
    folder: Path | None = None,
    judge: Training | None = None,
    parent: Parent | None = None,
    flow: Flow | None = None,
) -> Material:
    """Training and validation windows and where they came from; the last voyages validate, a voyage is never split.

    With a `folder`, windows are in its files and are read from there as they are used; without, in memory. Validation
    windows start where `judge` has them start (a search compares trials on the same starts), or as the training ones do. A
    `parent` that the training starts from lends its servos where the logs do not tell them. With `flow` motion is that through
    the water of each voyage.
    Raises InputError when a voyage is of another vessel, or when there are fewer windows than asked for.
    """
    spec, sampling = training.windows.spec(), training.windows.sampling()
    starting = [(spec, sampling)] + ([] if judge is None else [(judge.windows.spec(), judge.windows.sampling())])
    store = None if folder is None else stream.Store(folder / "parts")
    parts: list[dict[str, list]] = [{} for _ in starting]  # by voyage: windows, or the files that hold them
    digest = hashlib.sha256()
    vessel, held = None, training.data.validation_voyages
    servos, estimated = _with_servos(_estimated(logs, spec, flow), starting[-1], held)
    servos = servos if parent is None else parent.servos(servos)
    for log, filtered, smoothed in estimated:
        vessel = vessel or log.vessel
        digest.update(pd.util.hash_pandas_object(log.table, index=False).to_numpy().tobytes())
        for by_voyage, where in zip(parts, starting, strict=True):
            rows = starts(filtered, *where)
            if len(rows):
                windows = make_windows(filtered, smoothed, spec, rows, servos)
                by_voyage.setdefault(log.voyage, []).append(windows if store is None else store.add(windows))
    teaching, judging = parts[0], parts[-1]
    if vessel is None or not judging:
        raise InputError(
            f"training {training.name}: no voyage has a window; it needs {spec.history:g} s before and {spec.horizon:g} s after its start"
        )
    names = list(judging)
    if held >= len(names):
        raise InputError(
            f"training {training.name}: {len(names)} voyages with windows, {held} of them for validation leave none to train on"
        )
    cut = len(names) - held
    limits = training.windows.train, training.windows.validation
    windows = _chosen(training, teaching, names[:cut], limits[0], "train", folder)
    validation = _chosen(training, judging, names[cut:], limits[1], "validation", folder) if held else None
    if store is not None:
        store.clear()
    facts = {
        "data_sha256": digest.hexdigest(),
        "training_voyages": names[:cut],
        "validation_voyages": names[cut:],
        "training_windows": len(windows),
        "validation_windows": 0 if validation is None else len(validation),
    }
    return Material(vessel, windows, validation, facts, servos)


Estimated = tuple[Log, States, States]  # a log with its filtered and its smoothed states


def _estimated(logs: Iterable[Log], spec: WindowSpec, flow: Flow | None) -> Iterator[Estimated]:
    """Logs of one vessel with their states. Raises InputError when one is of another."""
    first = None
    for log in logs:
        first = first or log.vessel
        if log.vessel.name != first.name:
            raise InputError(
                f"{log.path or log.voyage}: vessel {log.vessel.name} among voyages of {first.name}; train on one vessel"
            )
        # Driven by its accelerometers, the filter in three dimensions follows a boat so closely that its states serve as labels.
        # The network of ships without a gyro sees what positions tell, and is taught by what a gyro would have told.
        filtered = filter_spatial(log) if spec.spatial else filter_course(log) if spec.course_only else filter_log(log)
        smoothed = filtered if spec.spatial else smooth_log(log)
        if flow is not None:
            current = flow(filtered)
            filtered, smoothed = (from_the_water(states, current) for states in (filtered, smoothed))
        yield log, filtered, smoothed


def _with_servos(
    voyages: Iterator[Estimated], where: tuple[WindowSpec, Sampling], held: int
) -> tuple[Servos | None, Iterator[Estimated]]:
    """The servos by the first SERVO_HOURS of voyages, the last `held` of them left out, and all voyages again.

    None where no forcing goes through a servo. Only these first voyages are kept in memory.
    """
    if not {"rudder_angle", "shaft_speed"} & set(where[0].forcings):
        return None, voyages
    first: list[Estimated] = []
    hours, after = 0.0, 0
    for voyage in voyages:
        first.append(voyage)
        after += hours >= SERVO_HOURS
        hours += (voyage[1]["time_s"][-1] - voyage[1]["time_s"][0]) / 3600
        if hours >= SERVO_HOURS and after == held:
            break
    names = list(dict.fromkeys(log.voyage for log, filtered, _ in first if len(starts(filtered, *where))))
    validate = set(names[len(names) - held :])
    teach = [(log, smoothed) for log, _, smoothed in first if log.voyage not in validate]
    return identify_servos(teach, first[0][0].vessel) if first else None, chain(first, voyages)


def _chosen(
    training: Training, parts: dict[str, list], names: list[str], limit: int | None, what: str, folder: Path | None
) -> Windows:
    """The windows of some voyages, the first `limit` of them, in `folder` or in memory. Raises InputError when there are fewer."""
    found: Sequence = [part for name in names for part in parts.get(name, [])]
    windows = concatenate(found) if folder is None else stream.join(found, folder / f"{what}.safetensors", limit)
    if limit is None:
        return windows
    if len(windows) < limit:
        raise InputError(
            f"training {training.name}: windows.{what} asks for {limit} windows, {len(names)} voyages have {len(windows)}; "
            "add voyages"
        )
    return windows.select(np.arange(limit)) if folder is None else windows


def train_bundle(
    training: Training,
    material: Material,
    folder: Path,
    quiet: bool = False,
    shared: tuple[int, int] = (1, 1),
    hear: fit.Hear | None = None,
    parent: Parent | None = None,
) -> Bundle:
    """Train the network of a training file on its material. `folder` gets curves, logs and what a killed run needs.

    `shared` are the devices on each node and the nodes that train together; `hear` as in fit.fit. With a `parent` its network
    learns on, scaling as it is. Raises InputError where that is of other windows, another kind, other sizes or another hull.
    """
    _check(training, material, parent)
    facts = material.facts if parent is None else {**material.facts, "parent": parent.facts()}
    torch.set_num_threads(
        1
    )  # as in fit.fit, and before: how threads share a sum would decide the last bits of a regression
    if fit.node_rank(shared[1]) == 0:
        _start_run(folder, training, facts)
    else:
        _await_run(folder, training, facts)
    settings = fit.FitSettings(**training.fit.model_dump(), devices=shared[0], nodes=shared[1])
    windows, net = material.train, training.network
    curves: dict[str, list[dict[str, float]]] = {}
    begun: Any = None if parent is None else copy.deepcopy(parent.bundle.network)
    network: ThesisGru | RolloutGru | RolloutEnsemble | IdentifiedShip | HybridGru | CorrectedShip
    if isinstance(net, ThesisNet):
        torch.manual_seed(settings.seed)
        network = begun or _thesis(net, windows)
        for which, name in enumerate(windows.spec.targets):
            loss, title = fit.thesis_loss(which), f"training {name}"
            curves[name] = fit.fit(
                network, loss, windows, material.validation, settings, folder / name, title, quiet, hear
            )
    else:
        start, growth = net.heading_tolerance_deg
        heading = math.radians(start), math.radians(growth)
        loss = fit.path_loss(fit.Tolerance(net.position_tolerance_m, heading, net.velocity_tolerance_m_s))
        if isinstance(net, IdentifiedNet | HybridNet | CorrectedNet):
            network = ship = _ship(begun) or identify(net, windows, material.vessel)
            # The ship of a hybrid, and the one that is corrected, is trained alone before.
            own = settings if isinstance(net, IdentifiedNet) else replace(settings, epochs=net.ship_epochs)
            if isinstance(net, HybridNet | CorrectedNet):
                own = replace(own, learning_rate=net.ship_learning_rate)
            if isinstance(net, HybridNet):
                settings = replace(settings, ship_share=net.ship_share)
            place, title = folder / "identified", "training identified ship"
            if own.epochs and (begun is None or isinstance(net, IdentifiedNet)):
                curves[place.name] = fit.fit(ship, loss, windows, material.validation, own, place, title, quiet, hear)
            if isinstance(net, HybridNet):
                torch.manual_seed(settings.seed)
                network = begun or _hybrid(net, windows, ship)
                place, title = folder / "hybrid", "training hybrid"
                curves[place.name] = fit.fit(
                    network, loss, windows, material.validation, settings, place, title, quiet, hear
                )
            elif isinstance(net, CorrectedNet):
                torch.manual_seed(settings.seed)
                network = whole = begun or _corrected(net, windows, ship)
                rolled, unseen = _rolled_out(whole, windows), material.validation
                unseen = None if unseen is None else _rolled_out(whole, unseen)
                for k in range(net.members):
                    member = cast(Correction, whole.members[k])
                    own, name = replace(settings, seed=settings.seed + k), f"correction-{k + 1}"
                    taught, title = Taught(whole, member), f"training {name}"
                    curves[name] = fit.fit(taught, loss, rolled, unseen, own, folder / name, title, quiet, hear)
        else:
            members = []
            for k in range(net.members):
                own = replace(settings, seed=settings.seed + k)
                torch.manual_seed(own.seed)
                members.append(_member(begun, k) or _rollout(net, windows, material.vessel))
                name = "rollout" if k == 0 else f"rollout-{k + 1}"
                curves[name] = fit.fit(
                    members[k], loss, windows, material.validation, own, folder / name, f"training {name}", quiet, hear
                )
            network = members[0]
            if net.members > 1:
                network = RolloutEnsemble(members[0].sizes)
                network.members = torch.nn.ModuleList(members)
    domain = _domain(windows, getattr(net, "wind", False))
    return Bundle(
        name=training.name,
        network=network,
        spec=windows.spec,
        vessel=replace(material.vessel, simulator={}),  # the simulator's secrets are not the predictor's
        region_map=isinstance(net, ThesisNet),
        domain=domain if parent is None else widest(parent.bundle.domain, domain),
        servos=material.servos,
        provenance={
            "aspnn": __version__,
            "torch": torch.__version__,
            "training": plain(training),
            **facts,
            "curves": {name: _columns(rows) for name, rows in curves.items()},
        },
    )


def _check(training: Training, material: Material, parent: Parent | None) -> None:
    if parent is not None:
        check_parent(training, parent.bundle)
        check_hull(material.vessel, parent.bundle)
    elif training.fit.towards_parent or not training.fit.epochs:
        raise InputError(
            f"training {training.name}: fit.{'towards_parent' if training.fit.epochs else 'epochs'} is of fine-tuning; "
            "name a parent with --from CHECKPOINT"
        )


def _ship(begun: Any) -> IdentifiedShip | None:
    """The identified ship in a network that learns on."""
    return begun if begun is None or isinstance(begun, IdentifiedShip) else begun.ship


def _member(begun: Any, k: int) -> RolloutGru | None:
    """Roll-out GRU number `k` of a network that learns on."""
    return begun if begun is None or isinstance(begun, RolloutGru) else begun.members[k]


def _columns(rows: list[dict[str, float]]) -> dict[str, list[float]]:
    """The curves of one network by their names, to the digits that a reader needs; the loss of every epoch in turn."""
    return {k: [float(f"{row[k]:.5g}") for row in rows] for k in rows[0] if k != "epoch"} if rows else {}


def _thesis(net: ThesisNet, windows: Windows) -> ThesisGru:
    """Paper V's networks, scaled by the extremes of the training windows, the rudder by 45 degrees (Paper V 20)."""
    spec = windows.spec
    network = ThesisGru(ThesisSizes(len(spec.inputs), spec.horizon_steps, net.latent, net.dense))
    low, high = flat_range(fit.tensor(windows.history))
    if "rudder_order" in spec.inputs:
        rudder, limit = spec.inputs.index("rudder_order"), math.radians(net.rudder_limit_deg)
        low[rudder], high[rudder] = -limit, limit
    network.history.set(low, high)
    network.target.set(*flat_range(fit.tensor(windows.target)))
    return network


def _rollout(net: RolloutNet, windows: Windows, vessel: Vessel) -> RolloutGru:
    """The roll-out GRU, scaled by two standard deviations of the training windows. Raises InputError."""
    spec = windows.spec
    now = _now(windows)
    bow, stern = vessel.sway_stations
    sizes = RolloutSizes(
        len(spec.inputs), len(spec.forcings), now, bow, stern, spec.period, net.wind, net.latent, net.members
    )
    network = RolloutGru(sizes)
    history, forcing, wind = (fit.tensor(getattr(windows, n)) for n in ("history", "forcing", "wind"))
    network.history.set(*flat_range(history, 2.0))
    network.forcing.set(*flat_range(forcing, 2.0))
    network.motion.set(*flat_range(stream.mapped_motion(network.to_motion, windows.target), 2.0))
    network.wind.set(*flat_range(wind, 2.0))
    return network


def _now(windows: Windows) -> tuple[int, int, int]:
    """The places of surge, bow sway and stern sway among the inputs. Raises InputError."""
    spec = windows.spec
    missing = [name for name in spec.targets if name not in spec.inputs]
    if missing:
        raise InputError(f"windows.inputs: {missing[0]} is missing; the roll-out starts from it")
    surge, bow_sway, stern_sway = (spec.inputs.index(name) for name in spec.targets)
    return surge, bow_sway, stern_sway


def identify(net: IdentifiedNet | HybridNet | CorrectedNet, windows: Windows, vessel: Vessel) -> IdentifiedShip:
    """The identified ship by ridge regression on the training windows. Raises InputError, and RunsAway."""
    spec, now = windows.spec, _now(windows)
    driven = tuple(name for name in ("rudder_angle", "shaft_speed") if name in spec.forcings)
    if "rudder_angle" not in driven:
        raise InputError("windows.forcings: rudder_angle is missing; a ship is identified by what its rudder does")
    missing = [name for name in driven if name not in spec.inputs]
    if missing:
        raise InputError(
            f"windows.inputs: {missing[0]} is missing; the identified ship sails through the history by it"
        )
    bow, stern = vessel.sway_stations
    forcing, seen = (tuple(names.index(name) for name in driven) for names in (spec.forcings, spec.inputs))
    ship = IdentifiedShip(IdentifiedSizes(forcing, seen, now, bow, stern, spec.period, net.wind))
    target, forced, wind, turn = (
        fit.tensor(array) for array in (windows.target, windows.forcing, windows.wind, windows.path[..., 2])
    )
    ship.regress(target, forced, wind, turn, net.ridge)
    ship.settle(*(fit.tensor(array) for array in (windows.history, windows.target, windows.wind)))
    some = slice(None, None, max(1, len(windows) // 1000))
    with torch.inference_mode():
        found = ship(*(fit.tensor(array[some]) for array in (windows.history, windows.forcing, windows.wind)))
    if not (ship.to_motion(found).abs() < ship.limit).all():
        raise RunsAway(
            f"network.ridge: with {net.ridge:g} the identified ship runs away within {spec.horizon:g} s; raise it tenfold"
        )
    return ship


def _hybrid(net: HybridNet, windows: Windows, ship: IdentifiedShip) -> HybridGru:
    """The hybrid about a trained ship, scaled by two standard deviations of the training windows."""
    spec = windows.spec
    network = HybridGru(HybridSizes(len(spec.inputs), len(spec.forcings), **asdict(ship.sizes), latent=net.latent))
    network.ship.load_state_dict(ship.state_dict())
    history, forcing, wind = (fit.tensor(getattr(windows, n)) for n in ("history", "forcing", "wind"))
    network.history.set(*flat_range(history, 2.0))
    network.forcing.set(*flat_range(forcing, 2.0))
    network.motion.set(*flat_range(stream.mapped_motion(ship.to_motion, windows.target), 2.0))
    network.wind.set(*flat_range(wind, 2.0))
    return network


def _corrected(net: CorrectedNet, windows: Windows, ship: IdentifiedShip) -> CorrectedShip:
    """The corrected ship about a trained ship, scaled by two standard deviations of the training windows."""
    spec = windows.spec
    network = corrected(ship, len(spec.inputs), len(spec.forcings), net.latent, net.members)
    rolled = fit.tensor(_rolled_out(network, windows).forcing[..., len(spec.forcings) :])
    network.scale(fit.tensor(windows.history), rolled, fit.tensor(windows.forcing))
    return network


def _rolled_out(network: CorrectedShip, windows: Windows) -> Windows:
    """The windows with the roll-outs of the network's ship beside their forcings: see corrected.Taught."""
    inputs = (fit.tensor(array).split(256) for array in (windows.history, windows.forcing, windows.wind))
    with torch.no_grad():
        rolled = torch.cat([network.roll(*part) for part in zip(*inputs, strict=True)]).numpy()
    return replace(windows, forcing=np.concatenate([windows.forcing, rolled], axis=-1))


def plain(training: Training) -> dict[str, Any]:
    """The training file as plain data: what decides the weights, not where the file and the windows lie."""
    return json.loads(training.model_dump_json(exclude={"folder": True, "search": True, "data": {"stream"}}))


def _run(training: Training, facts: dict[str, Any]) -> str:
    """What a run folder is of."""
    run = {"training": plain(training), "data": facts["data_sha256"]}
    return json.dumps(run | ({"parent": facts["parent"]["model_sha256"]} if "parent" in facts else {}), indent=1)


def _await_run(folder: Path, training: Training, facts: dict[str, Any]) -> None:
    """Wait until the first node has begun this run in `folder`, which the nodes share. Raises InputError after ten minutes."""
    note, run = folder / "run.json", _run(training, facts)
    for _ in range(3000):
        if note.exists() and note.read_text() == run:
            return
        time.sleep(0.2)
    raise InputError(
        f"{folder}: node 0 has not begun this training here; nodes need one run folder, training file and logs"
    )


def _start_run(folder: Path, training: Training, facts: dict[str, Any]) -> None:
    """Keep `folder` if it holds the same run, to be resumed; clear what training wrote there if it holds another."""
    run = _run(training, facts)
    note = folder / "run.json"
    if note.exists() and note.read_text() != run:
        for old in (
            *folder.glob("rollout*"),
            *folder.glob("correction-*"),
            *(folder / name for name in ("checkpoint", "surge", "sway_bow", "sway_stern", "identified", "hybrid")),
        ):
            shutil.rmtree(old, ignore_errors=True)
    with records.atomic(note) as temporary:
        temporary.write_text(run)


def _domain(windows: Windows, windy: bool) -> dict[str, list[float]]:
    """Lowest and highest of every input and forcing among the training windows, and of the wind's speed where the network is `windy`."""
    spec = windows.spec
    found: dict[str, list[float]] = {}
    for names, values in ((spec.inputs, windows.history), (spec.forcings, windows.forcing)):
        for k, name in enumerate(names):
            low, high = float(values[..., k].min()), float(values[..., k].max())
            old = found.get(name, [low, high])
            found[name] = [min(low, old[0]), max(high, old[1])]
    if windy:
        found[WIND] = [0.0, float(np.hypot(*windows.wind.T).max())]
    return found
