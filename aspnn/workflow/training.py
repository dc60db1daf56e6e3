"""Logs to windows to checkpoints: what a training file describes, trained, fine-tuned or searched."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from glob import glob
from pathlib import Path

import numpy as np

from aspnn import records
from aspnn.learning.config import Training, read_training
from aspnn.learning.windows import write_windows
from aspnn.records import Log, States
from aspnn.simulation.scenario import read_scenario, simulate_scenario
from aspnn.workflow.shared import Watch, silent


def training_logs(training: Training, watch: Watch = silent) -> Iterator[Log]:
    """The logs of a training file, simulated or read, in a fixed order."""
    data = training.data
    for source in data.scenarios or (() if data.scenario is None else (data.scenario,)):
        scenario = read_scenario(training.folder / source)
        count = data.voyages or scenario.voyages
        yield from (log for log, _ in watch(simulate_scenario(scenario, count), f"simulating {scenario.name}", count))
    if not data.logs:
        return
    sources = [
        training.folder / path  # an absolute one stays as it is
        for pattern in data.logs
        for path in sorted(glob(pattern, root_dir=training.folder, recursive=True)) or [pattern]
    ]
    files = [file for file in records.log_files(sources) if not any(word in file.name for word in data.exclude)]
    for file in watch(files, "filtering", len(files)):
        yield records.read_log(file)


def window_files(
    logs: Sequence[str | Path], config: str | Path, out: str | Path, watch: Watch = silent
) -> list[tuple[Path, int]]:
    """Windowed datasets of logs as a training file cuts them; the files written, with their numbers of windows."""
    from aspnn.learning.train import training_material

    files = records.log_files(logs)
    material = training_material(
        read_training(config), (records.read_log(f) for f in watch(files, "filtering", len(files)))
    )
    made = []
    for name, windows in (("train", material.train), ("validation", material.validation)):
        if windows is not None:
            made.append((Path(out) / f"{name}.safetensors", len(windows)))
            write_windows(windows, made[-1][0])
    return made


def train(
    config: str | Path,
    out: str | Path | None = None,
    seed: int | None = None,
    checkpoint: str | Path | None = None,
    quiet: bool = False,
    watch: Watch = silent,
    devices: int = 1,
    nodes: int = 1,
    start: str | Path | None = None,
    tell: Callable[[str], None] = lambda line: None,
) -> Path:
    """Train what a training file describes; returns the folder of the checkpoint bundle.

    `out` (default runs/NAME) gets the bundle in `checkpoint/`, curves and logs by network, and what a killed run needs to
    go on; the same call goes on. A run of other settings in `out` starts anew. `checkpoint` gets a copy of the bundle.
    `devices` processes on each of `nodes` machines train together; only the first machine writes the bundle. With data.stream
    windows lie in `windows/` of the run folder (`windows-N/` for machine N). `start` is a checkpoint to fine-tune (see
    learning.finetune); `tell` gets a line on what of it does not hold any more.
    """
    from aspnn.learning import fit
    from aspnn.learning.card import model_card
    from aspnn.learning.checkpoint import write_bundle
    from aspnn.learning.finetune import Parent, check_parent
    from aspnn.learning.train import train_bundle, training_material

    training = read_training(config)
    if seed is not None:
        training = training.model_copy(update={"fit": training.fit.model_copy(update={"seed": seed})})
    folder = Path(out) if out else Path("runs") / training.name
    node = fit.node_rank(nodes)
    windows = folder / (f"windows-{node}" if node else "windows") if training.data.stream else None
    parent, flow = None, None
    if start is not None:
        parent = Parent.read(start)
        check_parent(training, parent.bundle)
        flow = flow_by(parent.bundle)
    material = training_material(training, training_logs(training, watch), windows, None, parent, flow)
    bundle = train_bundle(training, material, folder, quiet, (devices, nodes), parent=parent)
    if parent is not None and (parent.bundle.calibration or parent.bundle.choice):
        tell(
            f"{parent.bundle.name}: its regions and its choice are not those of {bundle.name}; calibrate that on logs of its own"
        )
    if node:
        return folder / "checkpoint"
    for place in (folder / "checkpoint", *([Path(checkpoint)] if checkpoint else [])):
        write_bundle(bundle, place, model_card(bundle))
    return folder / "checkpoint"


def flow_by(bundle) -> Callable[[States], np.ndarray] | None:
    """The steady current of a voyage as a calibrated checkpoint finds it; None for one that cannot."""
    from aspnn.prediction.current import can_estimate, voyage_current
    from aspnn.prediction.gru import GruPredictor

    predictor = GruPredictor(bundle)
    calibration = predictor.calibration
    if calibration is None or not can_estimate(bundle.spec):
        return None

    def flow(states: States) -> np.ndarray:
        own = replace(bundle, vessel=states.vessel)  # whose network runs on as if it were of this boat
        return voyage_current(own, predictor.velocities, states, calibration.drift).velocity[0]

    return flow


def search_file(
    config: str | Path,
    trials: int,
    processes: int = 1,
    out: str | Path | None = None,
    seed: int = 0,
    tell: Callable[[str], None] = lambda line: None,
    watch: Watch = silent,
):
    """Search the settings of a training file; returns the learning.search.Found. See learning.search.

    `out` (default runs/NAME-search) gets trials.csv, best.toml and the journal; the same call goes on. Raises InputError.
    """
    from aspnn.learning.search import search

    training = read_training(config)
    folder = Path(out) if out else Path("runs") / f"{training.name}-search"
    return search(training, training_logs, folder, trials, processes, seed, tell, watch)
