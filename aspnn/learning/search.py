"""Search for better settings of a training file with Optuna: trials share their windows, hopeless ones end early.

What a search may change stands in the section `[search]` of the training file (`config.SEARCHABLE`), each key path with a
range or choices; a file without one gets the `SPACES` of its kind of network. A trial trains one network (of an ensemble one
member) and is judged by its loss on the validation voyages after the last epoch; the mean of the three for the thesis's. All
trials are judged on windows with the same starts. After every epoch, a trial whose loss is worse than the median of the
others at that epoch is stopped, as is one whose identified ship runs away. Test voyages are never seen.

The study is a journal that several processes share, so a killed search goes on. What a trial tries follows from the seed, the
process and the trials ended before it; with one process a search repeats, killed or not.
"""

import csv
import hashlib
import json
import math
import multiprocessing
import os
import shutil
import time
import warnings
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from aspnn.learning.config import Choices, Range, ThesisNet, Training, write_training
from aspnn.learning.stream import map_windows
from aspnn.learning.train import Material, RunsAway, plain, train_bundle, training_material
from aspnn.records import Log, atomic
from aspnn.schema import InputError
from aspnn.vessel import from_dict

GRU: dict[str, Range | Choices] = {
    "network.latent": Range(low=16, high=96, step=8),
    "fit.learning_rate": Range(low=1e-3, high=3e-2, log=True),
    "fit.batch": Choices(choices=(32, 64, 128)),
    "fit.weight_decay": Range(low=1e-6, high=1e-2, log=True),
}
SHIP: dict[str, Range | Choices] = {"network.ridge": Range(low=1e-7, high=1e-1, log=True)}
BOTH = {**GRU, **SHIP, "network.latent": Range(low=8, high=64, step=8)}
SPACES: dict[str, dict[str, Range | Choices]] = {
    "rollout": GRU,
    "thesis": {**GRU, "network.latent": Range(low=32, high=256, step=32)},
    "identified": {
        **SHIP,
        "fit.learning_rate": Range(low=1e-4, high=1e-2, log=True),
        "fit.batch": Choices(choices=(32, 64, 128)),
    },
    "hybrid": {**BOTH, "network.ship_share": Range(low=1e-3, high=0.3, log=True)},
    "corrected": BOTH,
}
FEWEST = 4  # trials that end before any is stopped early
Logs = Callable[..., Iterable[Log]]  # (training, watch): the logs of a training file


@dataclass(frozen=True)
class Trial:
    """A trial that has ended: its values by key path, its loss (None when stopped early) and how long it took."""

    number: int
    values: dict[str, Any]
    loss: float | None
    epochs: int
    seconds: float


@dataclass(frozen=True)
class Found:
    """A search: its trials in the order they began, the best of them, and the files with the table and its training file."""

    trials: tuple[Trial, ...]
    best: Trial
    table: Path
    config: Path


def search(
    training: Training,
    logs: Logs,
    folder: Path,
    trials: int,
    processes: int = 1,
    seed: int = 0,
    tell: Callable[[str], None] = lambda line: None,
    watch: Callable[[Iterable, str, int], Iterable] = lambda things, what, count: things,
) -> Found:
    """Search until `trials` have ended, in all calls on `folder` together; it gets trials.csv, best.toml and the journal.

    `tell` gets a line per trial (with one process), `watch` the reading of the logs. Raises InputError, and KeyboardInterrupt that says how to go on.
    """
    optuna = _optuna()
    space = training.search or SPACES.get(training.network.kind)
    if space is None:
        raise InputError(
            f"training {training.name}: network kind {training.network.kind} has no search of its own; add a section [search]"
        )
    if not training.data.validation_voyages:
        raise InputError(
            f"training {training.name}: data.validation_voyages: a search judges by validation voyages; hold some out"
        )
    training = training.model_copy(update={"search": space})
    work = _Work(training, logs, folder, seed, processes)
    data = replace(work, logs=partial(logs, watch=watch)).make(training).facts["data_sha256"]
    work = replace(work, data=data)
    study = work.study()
    identity = json.dumps([plain(training), _plain(space), seed, data])
    if study.user_attrs.get("search", identity) != identity:
        raise InputError(f"{folder}: holds another search (settings, data or seed differ); name another --out")
    study.set_user_attr("search", identity)
    for stale in study.get_trials(states=(optuna.trial.TrialState.RUNNING,), deepcopy=False):
        study.tell(stale.number, state=optuna.trial.TrialState.FAIL)
    left = max(0, trials - len(_ended(study)))
    try:
        if processes == 1 or left <= 1:
            for _ in range(left):
                tell(_line(work.trial(study, 0)))
        else:
            _share(work, left, processes)
    except (KeyboardInterrupt, OSError) as stopped:
        if not _interrupted(stopped):
            raise
        raise KeyboardInterrupt(f"{len(_ended(study))} of {trials} trials; the same command goes on") from None
    return _report(study, training, folder)


def _interrupted(error: BaseException | None) -> bool:
    """Whether an error is an interrupt or came of one: in the moment in which the journal's lock changes hands, an interrupt lets
    it be given back twice, which fails for want of its file."""
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__context__
    return error is not None


def _optuna() -> Any:
    """Optuna, quiet. Raises InputError when it is not installed."""
    try:
        import optuna
    except ImportError:
        raise InputError("aspnn search needs Optuna: pip install 'aspnn[search]'") from None
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    warnings.filterwarnings("ignore", category=optuna.exceptions.ExperimentalWarning)
    return optuna


def _plain(space: dict[str, Range | Choices]) -> dict[str, Any]:
    """A search space as plain data."""
    return {path: values.model_dump(exclude_none=True) for path, values in space.items()}


def _judge(training: Training) -> Training:
    """Where validation windows start in every trial: as in the file, with enough before them for the longest history."""
    searched = training.search.get("windows.history_s")
    longest = max(training.windows.history_s, *(searched.probes() if searched else (0.0,)))
    return training.changed({"windows.history_s": longest})


@dataclass(frozen=True)
class _Work:
    """What each process of a search needs."""

    training: Training
    logs: Logs
    folder: Path
    seed: int
    processes: int
    data: str = ""  # SHA-256 of the logs

    def study(self) -> Any:
        """The study that lies in the folder, begun if there is none."""
        optuna = _optuna()
        self.folder.mkdir(parents=True, exist_ok=True)
        backend = optuna.storages.journal.JournalFileBackend(str(self.folder / "journal.log"))
        return optuna.create_study(
            study_name=self.training.name,
            storage=optuna.storages.JournalStorage(backend),
            pruner=optuna.pruners.MedianPruner(FEWEST, n_warmup_steps=1),
            load_if_exists=True,
        )

    def place(self, training: Training) -> Path:
        """The folder of the windows that a training file cuts."""
        cut = training.windows.model_dump_json()
        return self.folder / "windows" / hashlib.sha256(cut.encode()).hexdigest()[:12]

    def make(self, training: Training) -> Material:
        """Cut the windows of a training file, into their folder when they are whole."""
        place = self.place(training)
        making = place.with_name(f"{place.name}-{os.getpid()}")
        material = training_material(training, self.logs(training), making, _judge(self.training))
        note = {"facts": material.facts, "vessel": material.vessel.to_dict()}
        (making / "material.json").write_text(json.dumps(note))
        shutil.rmtree(place, ignore_errors=True)
        making.rename(place)
        return self.read(place)

    def material(self, training: Training) -> Material:
        """The windows of a training file, cut now if no trial has used them yet."""
        place = self.place(training)
        note = place / "material.json"
        found = json.loads(note.read_text()) if note.exists() else None
        if found is None or found["facts"]["data_sha256"] != self.data:
            return self.make(training)
        return self.read(place)

    def read(self, place: Path) -> Material:
        """The windows in a folder of `make`, mapped."""
        note = json.loads((place / "material.json").read_text())
        train, validation = (map_windows(place / f"{name}.safetensors") for name in ("train", "validation"))
        return Material(from_dict(note["vessel"], str(place)), train, validation, note["facts"])

    def trial(self, study: Any, process: int) -> Trial:
        """Run one trial. What it tries follows from the seed, the process and how many trials have ended."""
        optuna = _optuna()
        number = (self.seed * 1_000_003 + len(_ended(study)) * 1009 + process) % 2**32
        study.sampler = optuna.samplers.TPESampler(seed=number, constant_liar=self.processes > 1)
        trial = study.ask()
        begun = time.perf_counter()
        values = {path: _suggest(trial, path, space) for path, space in self.training.search.items()}
        training = self.training.changed(values)
        if "members" in type(training.network).model_fields:
            training = training.changed({"network.members": 1})
        losses: dict[str, float] = {}
        epochs = 0

        def hear(title: str, row: dict[str, float]) -> None:
            nonlocal epochs
            epochs += 1
            losses[title] = row["validation_loss"]
            if not math.isfinite(losses[title]):
                raise optuna.TrialPruned
            trial.report(losses[title], epochs)
            if trial.should_prune():
                raise optuna.TrialPruned

        run = self.folder / "trials" / f"{trial.number:04d}"
        shutil.rmtree(run, ignore_errors=True)
        try:
            train_bundle(training, self.material(training), run, quiet=True, hear=hear)
            judged = list(losses.values())
            if not isinstance(training.network, ThesisNet):
                judged = judged[-1:]  # a ship that was trained before the whole is no part of the result
            loss = math.fsum(judged) / len(judged)
            state = optuna.trial.TrialState.COMPLETE
        except (optuna.TrialPruned, RunsAway):
            loss, state = None, optuna.trial.TrialState.PRUNED
        for resume in run.glob("*/resume"):
            shutil.rmtree(resume)
        trial.set_user_attr("epochs", epochs)
        trial.set_user_attr("seconds", round(time.perf_counter() - begun, 3))
        study.tell(trial, loss, state=state)
        return _read(study.get_trials(deepcopy=False)[trial.number])


def _suggest(trial: Any, path: str, space: Range | Choices) -> Any:
    """A value of the space. Lists go through Optuna as JSON, which knows plain values only."""
    if isinstance(space, Choices):
        return json.loads(trial.suggest_categorical(path, [json.dumps(value) for value in space.choices]))
    if all(isinstance(value, int) for value in (space.low, space.high, space.step or 1)):
        return trial.suggest_int(path, space.low, space.high, step=space.step or 1, log=space.log)
    return trial.suggest_float(path, space.low, space.high, step=space.step, log=space.log)


def _ended(study: Any) -> list[Any]:
    """Trials that ended, whole or stopped early; one that was killed counts for nothing."""
    state = _optuna().trial.TrialState
    return study.get_trials(deepcopy=False, states=(state.COMPLETE, state.PRUNED))


def _read(frozen: Any) -> Trial:
    """A trial out of the study."""
    values = {
        path: json.loads(value) if isinstance(value, str) else value for path, value in sorted(frozen.params.items())
    }
    whole = frozen.state.name == "COMPLETE"
    attrs = frozen.user_attrs
    return Trial(frozen.number, values, frozen.value if whole else None, attrs["epochs"], attrs["seconds"])


def _shown(value: Any) -> str:
    """A value of a trial as text."""
    return f"{value:.4g}" if isinstance(value, float) else json.dumps(value) if isinstance(value, list) else str(value)


def _line(trial: Trial) -> str:
    """A line on a trial."""
    values = ", ".join(f"{path} {_shown(value)}" for path, value in trial.values.items())
    ended = f"stopped after {trial.epochs} epochs" if trial.loss is None else f"loss {trial.loss:.5g}"
    return f"trial {trial.number}: {ended} ({values})"


def _share(work: _Work, left: int, processes: int) -> None:
    """Run `left` trials in several processes. Raises InputError of the first that met one."""
    context = multiprocessing.get_context("spawn")
    tickets, faults = context.Value("i", left), context.SimpleQueue()
    workers = [
        context.Process(target=_worker, args=(work, k, tickets, faults), daemon=True)
        for k in range(min(processes, left))
    ]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    if not faults.empty():
        raise InputError(faults.get())
    broken = [str(worker.exitcode) for worker in workers if worker.exitcode]
    if broken:
        raise InputError(f"{work.folder}: a process of the search ended with code {broken[0]}; call again to go on")


def _worker(work: _Work, process: int, tickets: Any, faults: Any) -> None:
    """One process of a search: trials as long as there are tickets."""
    study = work.study()
    try:
        while True:
            with tickets.get_lock():
                if tickets.value <= 0:
                    return
                tickets.value -= 1
            work.trial(study, process)
    except InputError as error:
        tickets.value = 0
        faults.put(str(error))
    except KeyboardInterrupt:
        tickets.value = 0  # the process that waits for this one says so


def _report(study: Any, training: Training, folder: Path) -> Found:
    """Write trials.csv and best.toml. Raises InputError when no trial came to its end."""
    trials = tuple(_read(frozen) for frozen in _ended(study))
    whole = [trial for trial in trials if trial.loss is not None]
    if not whole:
        raise InputError(f"{folder}: no trial has come to its end; try more trials, or other ranges in [search]")
    best = min(whole, key=lambda trial: trial.loss or 0.0)
    rows, config = folder / "trials.csv", folder / "best.toml"
    with atomic(rows) as temporary, open(temporary, "w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["trial", "validation_loss", "epochs", "seconds", *training.search])
        for t in trials:
            values = [json.dumps(v) if isinstance(v, list) else v for v in (t.values[path] for path in training.search)]
            writer.writerow([t.number, "" if t.loss is None else t.loss, t.epochs, t.seconds, *values])
    write_training(training.changed(best.values).model_copy(update={"name": f"{training.name}-best"}), config)
    return Found(trials, best, rows, config)


def table(found: Found, rows: int = 20) -> Any:
    """The best trials as a table for the terminal."""
    from rich.table import Table

    paths = list(found.best.values)
    shown = Table("trial", "loss", "epochs", "s", *paths, title=f"{len(found.trials)} trials, the best first")
    order = sorted(found.trials, key=lambda t: (t.loss is None, t.loss or 0.0, -t.epochs))
    for t in order[:rows]:
        loss = "stopped" if t.loss is None else f"{t.loss:.5g}"
        shown.add_row(str(t.number), loss, str(t.epochs), f"{t.seconds:.1f}", *(_shown(t.values[p]) for p in paths))
    return shown
