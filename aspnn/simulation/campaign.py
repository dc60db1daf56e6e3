"""Campaigns: a scenario's voyages by the thousand, made by parallel processes or on a Dask cluster into one folder.

`NAME.manifest.json` says what made them: version and source code, scenario, seed, vessel, and of every voyage its files with
rows and SHA-256. Each log carries the SHA-256 of all that but the files, its *campaign*. So a run that was stopped goes on when
called again: a voyage is complete when its log (written last) and its truth are of this campaign. Workers write voyages
themselves; only file names and hashes pass between processes. Depends on scenario, records, vessel and schema.
"""

import contextlib
import hashlib
import json
import logging
import math
import multiprocessing
import os
import re
import signal
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import CancelledError, Executor, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from aspnn import __version__, records
from aspnn.schema import InputError
from aspnn.simulation.scenario import Scenario, batch_size, simulate_scenario, stem, voyage_name, write_voyage
from aspnn.vessel import Vessel, load_vessel

PACKAGE = Path(__file__).parents[1]
SOURCES = (
    "simulation/**/*.py",
    "guidance/*.py",
    "estimation/course*.py",
    "estimation/sideslip.py",
    "angles.py",
    "frames.py",
    "orders.py",
    "records.py",
    "vessel.py",
)
WORTH = 200_000  # steps that are worth a process of their own, which takes a second or two to start
CONNECT = 20  # seconds that a Dask scheduler has to answer
Watch = Callable[[Iterable, str, int], Iterable]


class Task(NamedTuple):
    """Voyages that a worker makes in one go."""

    scenario: Scenario
    numbers: list[int]
    seed: int
    folder: str
    campaign: str


class Made(NamedTuple):
    """What a worker made: entries of the manifest, and what stopped it, if anything did.

    The problem travels as a value, since Dask and the process pools print, wrap and repeat exceptions each in its own way.
    """

    entries: list[dict[str, Any]]
    problem: InputError | OSError | None = None


def run_campaign(
    scenario: Scenario,
    out: str | Path,
    voyages: int | None,
    seed: int | None,
    workers: int | None,
    scheduler: str | None,
    watch: Watch,
) -> list[Path]:
    """Make the voyages of a scenario that `out` does not hold yet, and the manifest; returns all the logs.

    `voyages` and `seed` take the place of the scenario's where given. `workers` is the number of processes, 1 for this one
    alone, None for as many as there are cores and work for. `scheduler` is `local` for a Dask cluster of that many workers on
    this machine, or the address of a Dask scheduler, whose own workers must see `out` under the same path. The files are the
    same, bit by bit, whatever the workers. Processes are spawned: a script that asks for more than one worker needs the
    usual `if __name__ == "__main__":`.

    Raises InputError where the folder holds files of another campaign under these names. When the disk is full or a worker is
    lost (InputError too), or at Ctrl-C (KeyboardInterrupt), nothing is half-written and the same call goes on.
    """
    count = scenario.voyages if voyages is None else voyages
    seed = scenario.seed if seed is None else seed
    folder, manifest = Path(out).absolute(), Path(out) / f"{stem(scenario, seed)}.manifest.json"
    head = describe(scenario, seed, load_vessel(scenario.vessel))
    own = re.escape(stem(scenario, seed)) + r"(-\d{4,})?"
    before = _earlier(manifest, head, any(_like(folder, rf"{own}\.parquet")))
    _sweep(folder, own)
    known = {entry["voyage"]: entry for entry in before}
    numbers = range(max([count - 1, *known]) + 1)  # voyages that an earlier, larger run made stay in the manifest
    found = {}
    for number in watch(numbers, "looking for voyages", len(numbers)) if manifest.exists() else numbers:
        entry = _complete(folder, scenario, number, seed, head["campaign"], known.get(number))
        if entry:
            found[number] = entry
    missing = [number for number in range(count) if number not in found]
    names = [folder / f"{voyage_name(scenario, number, seed)}.parquet" for number in range(count)]

    def state() -> str:
        ready = sum(name.exists() for name in names)
        return f"{ready} of {count} voyages are complete in {out}; the same command makes the others"

    try:
        if missing:
            # Shows what is wrong with the scenario before a process starts, and leaves compiled code for all of them.
            short = scenario.model_copy(update={"duration_s": min(scenario.duration_s, 10.0)})
            for _ in watch(range(1), "preparing the simulator", 1):
                next(simulate_scenario(short, [0], seed))
            if not before:
                _write(manifest, head, [])  # says whose files these are from the first one on
        made = _made(scenario, missing, seed, folder, head["campaign"], workers, scheduler)
        for entry in watch(made, "simulating", len(missing)):
            found[entry["voyage"]] = entry
        _write(manifest, head, [found[number] for number in sorted(found)])
    except KeyboardInterrupt:
        raise KeyboardInterrupt(state()) from None
    except OSError as error:
        # pyarrow puts the system's message in a sentence of its own.
        reason = os.strerror(error.errno) if error.errno else str(error).splitlines()[0]
        raise InputError(f"{error.filename or out}: {reason}; {state()}") from None
    finally:
        _sweep(folder, own)
    return [Path(out) / name.name for name in names]


def describe(scenario: Scenario, seed: int, vessel: Vessel) -> dict[str, Any]:
    """The head of a manifest: all that decides what the voyages are, and as `campaign` the SHA-256 of it.

    How many voyages there are is no part of that, so a campaign can be made larger.
    """
    parameters = vessel.to_dict()
    makers = {
        "version": __version__,
        "code_sha256": _code_sha256(),
        "scenario": scenario.model_dump(mode="json", exclude={"voyages", "bridge"}),
        "seed": seed,
        "vessel": {"name": vessel.name, "parameters": parameters, "sha256": _sha256(parameters)},
    }
    return {"kind": "campaign", "format": 1, "campaign": _sha256(makers), **makers}


def _sha256(data: Any) -> str:
    """SHA-256 of the JSON of data: keys sorted, no spaces."""
    return hashlib.sha256(json.dumps(data, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def _code_sha256() -> str:
    """SHA-256 of the source that makes voyages: a version that is being worked on changes without its number."""
    files = sorted(path for pattern in SOURCES for path in PACKAGE.glob(pattern))
    return _sha256({path.relative_to(PACKAGE).as_posix(): path.read_text(encoding="utf-8") for path in files})


def _write(manifest: Path, head: dict[str, Any], entries: list[dict[str, Any]]) -> None:
    with records.atomic(manifest) as temporary:
        temporary.write_text(json.dumps({**head, "voyages": entries}, indent=1) + "\n", encoding="utf-8")


def _earlier(manifest: Path, head: dict[str, Any], logs: bool) -> list[dict[str, Any]]:
    """The voyages of the manifest that an earlier run left. Raises InputError where it and `logs` are of another campaign."""
    try:
        data = json.loads(manifest.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return []
    except ValueError:
        raise InputError(f"{manifest}: is damaged; remove it, complete voyages beside it are kept") from None
    if isinstance(data, dict) and data.get("campaign") == head["campaign"]:
        return data["voyages"]
    if logs:
        raise InputError(
            f"{manifest}: is of another campaign ({_difference(data, head)}); give another --out, or remove that"
            " campaign's files to make these"
        )
    return []


def _difference(there: Any, here: Any, key: str = "") -> str:
    """What differs first between the heads of two manifests."""
    if isinstance(there, dict) and isinstance(here, dict):
        for name in here:
            if name != "campaign" and there.get(name) != here[name]:
                return _difference(there.get(name), here[name], f"{key}.{name}" if key else name)
        gone = [name for name in there if name not in here]
        return f"{key}.{gone[0]} is not here" if key and gone else "older format"
    if key.endswith("sha256"):
        return f"{key} differs"
    there, here = ("absent" if x is None else json.dumps(x) for x in (there, here))
    return f"{key} is {there} there, {here} here" if len(there + here) < 60 else f"{key} differs"


def _complete(folder: Path, scenario: Scenario, number: int, seed: int, campaign: str, known) -> dict[str, Any] | None:
    """The manifest's entry of a voyage whose files are whole and of this campaign, else None: it is to be made.

    `known` is its entry in an earlier manifest, which files changed since no longer fit. Raises InputError where a log of
    something else lies in its place.
    """
    path = folder / f"{voyage_name(scenario, number, seed)}.parquet"
    if not path.exists():
        return None
    try:
        rows, log = records.read_metadata(path)
        if log.get("notes", {}).get("campaign") != campaign:
            raise _Foreign(path)
        truths, truth = records.read_metadata(path.with_suffix(".truth.parquet"))
    except _Foreign:
        raise InputError(f"{path}: is there, and not of this campaign; give another --out, or remove it") from None
    except InputError:  # damaged, as by a machine that lost its power, or without its truth
        return None
    if (truth.get("notes", {}).get("campaign"), truths, log["voyage"]) != (campaign, rows, path.stem):
        return None
    entry = _entry(path, number, rows)
    return entry if known in (None, entry) else None


class _Foreign(Exception):
    """A log of something else."""


def _entry(path: Path, number: int, rows: int) -> dict[str, Any]:
    """What the manifest says of a voyage."""
    truth = path.with_suffix(".truth.parquet")
    return {
        "voyage": number,
        "file": path.name,
        "rows": rows,
        "sha256": records.sha256(path),
        "truth": truth.name,
        "truth_sha256": records.sha256(truth),
    }


def _like(folder: Path, pattern: str) -> Iterator[Path]:
    """Files of a folder, if it is there, whose names match a regular expression."""
    return (path for path in folder.glob("*") if re.fullmatch(pattern, path.name))


def _sweep(folder: Path, own: str) -> None:
    """Remove what killed workers left of files that they were writing (see records.atomic); `own` matches their voyages."""
    for path in _like(folder, rf"\.{own}(\.truth|\.manifest)?(\.[a-z0-9]+)\.[a-z0-9_]{{8}}\3"):
        path.unlink(missing_ok=True)


def voyages_of(task: Task) -> Iterator[dict[str, Any]]:
    """Make and write the voyages of a task, one after the other; yields their entries. Raises InputError and OSError."""
    if describe(task.scenario, task.seed, load_vessel(task.scenario.vessel))["campaign"] != task.campaign:
        raise InputError("a worker has another aspnn or another file of the vessel; give it those of this machine")
    made = simulate_scenario(task.scenario, task.numbers, task.seed)
    for number, (log, truth) in zip(task.numbers, made, strict=True):
        log = replace(log, notes={**log.notes, "campaign": task.campaign})
        yield _entry(write_voyage(log, truth, task.folder), number, len(log))


def make_voyages(task: Task) -> Made:
    """What a worker does with a task."""
    entries: list[dict[str, Any]] = []
    try:
        for entry in voyages_of(task):
            entries.append(entry)
    except (InputError, OSError) as error:
        return Made(entries, error)
    return Made(entries)


def _made(scenario, missing, seed, folder, campaign, workers, scheduler) -> Iterator[dict[str, Any]]:
    """The entries of voyages as they are made. Raises InputError when a worker cannot go on or is lost, and OSError."""

    def tasks(hands: int) -> list[Task]:
        """As few as memory allows, and the same number for every worker."""
        parts = hands * math.ceil(len(missing) / (batch_size(scenario) * hands))
        numbers = np.array_split(missing, min(parts, len(missing)))
        return [Task(scenario, part.tolist(), seed, str(folder), campaign) for part in numbers]

    if not missing:
        return
    worth = round(scenario.duration_s / scenario.step_s) * len(missing) // WORTH
    processes = min(_cores(), worth) if workers is None else workers
    if scheduler is None and processes <= 1:
        for task in tasks(1):
            yield from voyages_of(task)
        return
    with _processes(processes) if scheduler is None else _dask(scheduler, workers) as hands:
        with _uninterrupted():
            futures = [hands.executor.submit(make_voyages, task) for task in tasks(hands.number)]
        for future in as_completed(futures):
            try:
                made = future.result()
            except hands.lost:
                raise ChildProcessError(
                    "a worker was ended from outside, perhaps for want of memory (fewer --workers need less)"
                ) from None
            for entry in made.entries:
                if not (folder / entry["file"]).exists():
                    raise FileNotFoundError("the workers do not see this folder; give one on a disk that all share")
                yield entry
            if made.problem:
                raise made.problem


class Hands(NamedTuple):
    """Workers: what takes their tasks, how many they are, and what it raises when one is lost."""

    executor: Executor
    number: int
    lost: tuple[type[BaseException], ...]


@contextlib.contextmanager
def _processes(workers: int) -> Iterator[Hands]:
    """Worker processes of this machine; they end at once when this one is interrupted, fails or dies."""
    context = multiprocessing.get_context("spawn")  # the one way that every system has, and safe beside threads
    reader, writer = context.Pipe(duplex=False)
    executor = ProcessPoolExecutor(workers, context, _follow, (reader,))
    try:
        yield Hands(executor, workers, (BrokenProcessPool,))
    except BaseException:
        writer.close()
        raise
    finally:
        executor.shutdown(cancel_futures=True)
        writer.close()


def _follow(reader: Connection) -> None:
    """Make a worker end as soon as the other end of its pipe is closed, if only by the death of the process that holds it.

    Ctrl-C reaches all processes of a terminal; the first one alone answers it, and closes the pipe.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def leave() -> None:
        wait([reader])
        os._exit(1)

    threading.Thread(target=leave, daemon=True).start()


@contextlib.contextmanager
def _uninterrupted() -> Iterator[None]:
    """Holds Ctrl-C back, also in processes started meanwhile, which would answer it with a traceback before `_follow` runs."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextlib.contextmanager
def _dask(scheduler: str, workers: int | None) -> Iterator[Hands]:
    """The workers of a Dask scheduler, or of a Dask cluster on this machine where `scheduler` is `local`."""
    try:
        from distributed import Client, LocalCluster
        from distributed.scheduler import KilledWorker
    except ImportError:
        raise InputError("--scheduler needs Dask; install it with pip install 'aspnn[scale]'") from None
    with contextlib.ExitStack() as stack:
        try:
            if scheduler == "local":
                with _uninterrupted():
                    cluster = LocalCluster(
                        n_workers=workers or _cores(),
                        threads_per_worker=1,
                        dashboard_address=None,
                        silence_logs=logging.CRITICAL,
                    )
                client = stack.enter_context(Client(stack.enter_context(cluster)))
            else:
                client = stack.enter_context(Client(scheduler, timeout=CONNECT))
                client.wait_for_workers(1, timeout=CONNECT)
        except (OSError, ValueError) as error:
            raise InputError(
                f"--scheduler {scheduler}: no Dask scheduler with workers answers there ({str(error).splitlines()[0]})"
            ) from None
        executor = client.get_executor(pure=False)
        try:
            yield Hands(executor, sum(client.nthreads().values()), (KilledWorker, CancelledError))
        finally:
            executor.shutdown(wait=False)


def _cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
