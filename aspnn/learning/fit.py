"""Training: the one module that imports Lightning. Seeded runs repeat bit by bit; a killed run goes on where it was.

Several processes (`FitSettings.devices`, `.nodes`) share each batch: the order of windows follows from seed and epoch as it
does in one process, process r of N takes every N-th window of a batch from its r-th on, and its loss is weighted by its
number of windows, so that the mean of the gradients is the gradient of the whole batch. Weights then differ from those of
one process by the rounding of that sum alone. A loss must therefore be a mean over the windows of a batch.
"""

import contextlib
import csv
import logging
import os
import signal
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import lightning
import numpy as np
import torch
from lightning.fabric.plugins.environments import LightningEnvironment
from lightning.pytorch.callbacks import Callback, ModelCheckpoint
from lightning.pytorch.loggers import CSVLogger, TensorBoardLogger
from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from torch import Tensor, nn
from torch.utils.data import DataLoader, Dataset, Sampler

from aspnn.learning.corrected import Taught
from aspnn.learning.identified import HybridGru, IdentifiedShip
from aspnn.learning.network import RolloutGru, ThesisGru, path_of
from aspnn.learning.windows import Windows
from aspnn.records import atomic
from aspnn.schema import InputError

Batch = tuple[Tensor, Tensor, Tensor, Tensor, Tensor]  # history, forcing, wind, target, path
Loss = Callable[[nn.Module, Batch], Tensor]
Hear = Callable[[str, dict[str, float]], None]  # (title of the training, one epoch of its curves)


@dataclass(frozen=True)
class FitSettings:
    """How long and how fast to train. `one_cycle` warms the rate up and anneals it to nothing; else it stays fixed.

    The ship of a hybrid, which was trained before, takes `ship_share` of the rate, and no weight decay. Weights are drawn back to
    where they began by `towards_parent` times the rate at every step (see finetune).
    `batch` is what all processes share: `devices` on each of `nodes` machines.
    """

    epochs: int
    batch: int = 64
    learning_rate: float = 1e-3
    one_cycle: bool = False
    weight_decay: float = 0.0
    clip: float | None = None
    seed: int = 1
    devices: int = 1
    nodes: int = 1
    ship_share: float = 1.0
    towards_parent: float = 0.0


@dataclass(frozen=True)
class Tolerance:
    """What the loss counts as one: position [m] and heading [rad], each at the start and per second, velocity [m/s]."""

    position: tuple[float, float]
    heading: tuple[float, float]
    velocity: float


def thesis_loss(which: int) -> Loss:
    """Mean squared error of scaled target `which` (Paper V 3.2.1)."""

    def loss(network: nn.Module, batch: Batch) -> Tensor:
        assert isinstance(network, ThesisGru)
        history, _, _, target, _ = batch
        scaled = network.target(target[:, 1:])[..., which]
        return nn.functional.mse_loss(network.one(which, history), scaled)

    return loss


def path_loss(tolerance: Tolerance) -> Loss:
    """Errors of the integrated path, its heading and the velocities, each over its tolerance, by a pseudo-Huber sum.

    The path is what users read, and errors of the velocities that cancel on it are small errors; the tolerance grows with
    time, so that the end of the horizon does not drown its beginning.
    """

    def soft(squares: Tensor) -> Tensor:
        return torch.sqrt(1 + squares) - 1

    def loss(network: nn.Module, batch: Batch) -> Tensor:
        assert isinstance(network, RolloutGru | IdentifiedShip | HybridGru | Taught)
        history, forcing, wind, target, path = batch
        sizes = network.sizes
        velocities = network(history, forcing, wind)
        error = path_of(velocities, sizes.period, sizes.x_bow, sizes.x_stern)[:, 1:] - path[:, 1:]
        time = torch.arange(1, error.shape[1] + 1) * sizes.period
        position = error[..., :2] / (tolerance.position[0] + tolerance.position[1] * time)[:, None]
        heading = error[..., 2] / (tolerance.heading[0] + tolerance.heading[1] * time)
        velocity = (velocities - target) / tolerance.velocity
        squares = (position.square().sum(-1), heading.square(), velocity[:, 1:].square().sum(-1))
        return (soft(squares[0]) + soft(squares[1]) + 0.3 * soft(squares[2])).mean()

    return loss


def tensor(array: np.ndarray) -> Tensor:
    """The array as a tensor on the same memory, to be read only (windows may be mapped from a file)."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*not writable.*")
        return torch.from_numpy(array)


class _Tensors(Dataset):
    """Windows as tensors, taken a batch at a time."""

    def __init__(self, windows: Windows):
        arrays = (windows.history, windows.forcing, windows.wind, windows.target, windows.path)
        self.tensors = tuple(tensor(a) for a in arrays)

    def __len__(self) -> int:
        return len(self.tensors[0])

    def __getitem__(self, which: list[int]) -> Batch:
        return tuple(t[which] for t in self.tensors)  # type: ignore[return-value]


def _part() -> tuple[int, int]:
    """Number of this process and how many share the training."""
    together = torch.distributed.is_available() and torch.distributed.is_initialized()
    return (torch.distributed.get_rank(), torch.distributed.get_world_size()) if together else (0, 1)


class _Shuffle(Sampler):
    """Batches in an order that follows from seed and epoch alone, so that a resumed run sees what it would have seen.

    Where processes share a batch, each gets its part of it (module docstring).
    """

    def __init__(self, count: int, batch: int, seed: int):
        self.count, self.batch, self.seed = count, batch, seed
        self.steps: Callable[[], int] = lambda: (
            0
        )  # taken so far; Lightning's count of epochs is one behind on resumption

    def __len__(self) -> int:
        return -(-self.count // self.batch)

    def __iter__(self) -> Iterator[list[int]]:
        generator = torch.Generator().manual_seed(1_000_003 * self.seed + self.steps() // len(self))
        order = torch.randperm(self.count, generator=generator).tolist()
        rank, world = _part()
        batches = (order[k : k + self.batch] for k in range(0, self.count, self.batch))
        # A last batch of fewer windows than processes: those left over take its first window, with no weight.
        return batches if world == 1 else (batch[rank::world] or batch[:1] for batch in batches)

    def size(self, step: int) -> int:
        """Windows in batch number `step`, over all processes."""
        return min(self.batch, self.count - step * self.batch)

    def weight(self, step: int) -> float:
        """What to multiply this process's mean loss by, so that the mean over processes is the mean over the batch."""
        rank, world = _part()
        return len(range(rank, self.size(step), world)) * world / self.size(step)


class _Task(lightning.LightningModule):
    def __init__(self, network: nn.Module, loss: Loss, settings: FitSettings, train: _Shuffle, validation: _Shuffle):
        super().__init__()
        self.network, self.loss, self.settings = network, loss, settings
        self.train_order, self.validation_order = train, validation
        # Where they began, not where a resumed run goes on: Lightning restores that later.
        self.begun = {p: p.detach().clone() for p in network.parameters()} if settings.towards_parent else {}

    @torch.no_grad()
    def draw_back(self, optimizer: torch.optim.Optimizer, *_: Any) -> None:
        """After a step, the weights a little towards where they began."""
        for group in optimizer.param_groups:
            for weights in group["params"]:
                weights.lerp_(self.begun[weights], group["lr"] * self.settings.towards_parent)

    def setup(self, stage: str) -> None:
        torch.set_num_threads(1)  # Lightning would give each of several processes its share of the cores

    def training_step(self, batch: Batch, step: int) -> Tensor:
        return self.shared("train_loss", batch, self.train_order, step)

    def validation_step(self, batch: Batch, step: int) -> None:
        self.shared("validation_loss", batch, self.validation_order, step)

    def shared(self, name: str, batch: Batch, order: _Shuffle, step: int) -> Tensor:
        """This process's part of the loss of a batch; the mean over the epoch is logged."""
        loss, several = self.loss(self.network, batch), _part()[1] > 1
        if several:
            loss = order.weight(step) * loss
        self.log(name, loss, on_step=False, on_epoch=True, batch_size=order.size(step), sync_dist=several)
        return loss

    def configure_optimizers(self):
        s = self.settings
        groups: list[dict[str, Any]] = [{"params": list(self.parameters()), "lr": s.learning_rate}]
        if isinstance(self.network, HybridGru):
            ship = list(self.network.ship.parameters())
            others = [p for name, p in self.network.named_parameters() if not name.startswith("ship.")]
            groups[0]["params"] = others
            groups.append({"params": ship, "lr": s.ship_share * s.learning_rate, "weight_decay": 0.0})
        optimizer = torch.optim.AdamW(groups, weight_decay=s.weight_decay)
        if s.towards_parent:
            optimizer.register_step_post_hook(self.draw_back)
        if not s.one_cycle:
            return optimizer
        schedule = torch.optim.lr_scheduler.OneCycleLR(
            optimizer, [group["lr"] for group in groups], total_steps=s.epochs * len(self.train_order), pct_start=0.15
        )
        return {"optimizer": optimizer, "lr_scheduler": {"scheduler": schedule, "interval": "step"}}


class _Report(Callback):
    """A progress bar with epochs, losses and time left, and the curves as CSV, whole after every epoch."""

    def __init__(self, title: str, epochs: int, curves: Path, quiet: bool, hear: Hear | None):
        console = Console(stderr=True)
        columns: list[ProgressColumn] = [
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("epochs"),
        ]
        columns += [TextColumn("{task.fields[losses]}"), TimeElapsedColumn(), TextColumn("left"), TimeRemainingColumn()]
        self.progress = Progress(*columns, console=console, disable=quiet or not console.is_terminal)
        self.task = self.progress.add_task(title, total=epochs, losses="")
        self.title, self.curves, self.hear = title, curves, hear
        self.rows = _read_curves(curves) if curves.exists() else []

    def on_train_start(self, trainer, task) -> None:
        self.progress.disable |= not trainer.is_global_zero
        self.rows = [row for row in self.rows if row["epoch"] < trainer.current_epoch]
        self.progress.update(self.task, completed=trainer.current_epoch)
        self.progress.start()

    def on_train_epoch_end(self, trainer, task) -> None:
        metrics = {
            k: float(trainer.callback_metrics[k])
            for k in ("train_loss", "validation_loss")
            if k in trainer.callback_metrics
        }
        if not trainer.is_global_zero:
            return
        self.rows.append({"epoch": trainer.current_epoch, **metrics})
        with atomic(self.curves) as temporary, open(temporary, "w", newline="") as file:
            writer = csv.DictWriter(file, list(self.rows[-1]))
            writer.writeheader()
            writer.writerows(self.rows)
        losses = "  ".join(f"{k.split('_')[0]} {v:.4g}" for k, v in metrics.items())
        self.progress.update(self.task, advance=1, losses=losses)
        if self.hear:
            self.hear(self.title, self.rows[-1])

    def teardown(self, trainer, task, stage) -> None:
        self.progress.stop()


def _read_curves(path: Path) -> list[dict[str, float]]:
    """The rows of a curves.csv."""
    with open(path) as file:
        return [{k: int(v) if k == "epoch" else float(v) for k, v in r.items()} for r in csv.DictReader(file)]


def node_rank(nodes: int) -> int:
    """Number of this machine among the nodes of a training, from NODE_RANK; 0 writes the run."""
    return int(os.environ.get("NODE_RANK", 0)) if nodes > 1 else 0


def _strategy(settings: FitSettings, network: nn.Module) -> str:
    """Lightning's name of how processes share the work: forked ones read the same windows in memory. Raises InputError."""
    if settings.devices * settings.nodes == 1:
        return "auto"
    if not hasattr(os, "fork"):
        raise InputError("--devices: this system cannot fork processes; train with one device on one node")
    if settings.nodes > 1 and not {"MASTER_ADDR", "MASTER_PORT", "NODE_RANK"} <= set(os.environ):
        raise InputError(
            f"--num-nodes {settings.nodes}: set MASTER_ADDR, MASTER_PORT and NODE_RANK (0 to {settings.nodes - 1}) on every node"
        )
    # The thesis's networks are trained one by one: two thirds of the weights have no gradient.
    return "ddp_fork_find_unused_parameters_true" if isinstance(network, ThesisGru) else "ddp_fork"


@contextlib.contextmanager
def _interruptible() -> Iterator[None]:
    """Ctrl-C as Python has it: Lightning makes it an exit, and leaves the process deaf to the next one."""
    handler = signal.getsignal(signal.SIGINT)
    try:
        yield
    except SystemExit as stop:
        if isinstance(stop.__context__, KeyboardInterrupt):
            raise KeyboardInterrupt from None
        raise
    finally:
        if signal.getsignal(signal.SIGINT) is not handler:
            signal.signal(signal.SIGINT, handler)


def fit(
    network: nn.Module,
    loss: Loss,
    train: Windows,
    validation: Windows | None,
    settings: FitSettings,
    folder: str | Path,
    title: str = "training",
    quiet: bool = False,
    hear: Hear | None = None,
) -> list[dict[str, float]]:
    """Train `network` in place and return its curves: one dict per epoch with epoch, train_loss, validation_loss.

    `folder` gets `curves.csv`, `csv/` and `tensorboard/` logs and `resume/last.ckpt`, from which a killed run of the same
    call goes on, with any number of processes. One thread each: two make such small networks 4 to 16 times slower. `hear` is
    called after every epoch; what it raises ends the training. Ctrl-C is a KeyboardInterrupt, as elsewhere.
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    torch.set_num_threads(1)
    if settings.epochs == 0:
        network.eval()
        return []
    network.train()
    for name in ("lightning.pytorch", "lightning.fabric"):
        logging.getLogger(name).setLevel(logging.WARNING)
    lightning.seed_everything(settings.seed, workers=True, verbose=False)
    shuffle = _Shuffle(len(train), settings.batch, settings.seed)
    unseen = _Shuffle(0 if validation is None else len(validation), 256, 0)
    task = _Task(network, loss, settings, shuffle, unseen)
    report = _Report(title, settings.epochs, folder / "curves.csv", quiet, hear)
    # save_last without save_top_k would save at the very end alone.
    keep = ModelCheckpoint(folder / "resume", "last", save_top_k=1, every_n_epochs=1, enable_version_counter=False)
    last = folder / "resume" / "last.ckpt"
    with warnings.catch_warnings():
        warnings.filterwarnings(
            "ignore",
            message=".*(num_workers|validation_step|dirpath|LeafSpec|litlogger|log_every_n_steps|exists and is not empty).*",
        )
        trainer = lightning.Trainer(
            accelerator="cpu",
            devices=settings.devices,
            num_nodes=settings.nodes,
            strategy=_strategy(settings, network),
            plugins=[LightningEnvironment()] if settings.devices * settings.nodes > 1 else None,
            use_distributed_sampler=False,  # the order of windows is this module's own
            max_epochs=settings.epochs,
            deterministic=True,
            gradient_clip_val=settings.clip,
            logger=[CSVLogger(folder, "", "csv"), TensorBoardLogger(folder, "", "tensorboard")],
            callbacks=[report, keep],
            enable_progress_bar=False,
            enable_model_summary=False,
            num_sanity_val_steps=0,
            log_every_n_steps=10,
        )
        shuffle.steps = lambda: trainer.global_step
        unseen.steps = lambda: (trainer.global_step // len(shuffle) - 1) * len(unseen)  # after the epoch's steps
        with _interruptible():
            trainer.fit(
                task,
                DataLoader(_Tensors(train), sampler=shuffle, batch_size=None),
                None
                if validation is None or len(validation) == 0
                else DataLoader(_Tensors(validation), sampler=unseen, batch_size=None),
                ckpt_path=last if last.exists() else None,
                weights_only=True,
            )
    network.eval()
    # With several processes this one only waited for them; the curves are in the file.
    return report.rows if settings.devices * settings.nodes == 1 else _read_curves(report.curves)
