"""Training: the one module that imports Lightning. Seeded runs repeat bit by bit; a killed run goes on where it was."""

import csv
import logging
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import lightning
import torch
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

from aspnn.learning.network import RolloutGru, ThesisGru, path_of
from aspnn.learning.windows import Windows
from aspnn.records import atomic

Batch = tuple[Tensor, Tensor, Tensor, Tensor, Tensor]  # history, forcing, wind, target, path
Loss = Callable[[nn.Module, Batch], Tensor]


@dataclass(frozen=True)
class FitSettings:
    """How long and how fast to train. `one_cycle` warms the rate up and anneals it to nothing; else it stays fixed."""

    epochs: int
    batch: int = 64
    learning_rate: float = 1e-3
    one_cycle: bool = False
    weight_decay: float = 0.0
    clip: float | None = None
    seed: int = 1


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
        assert isinstance(network, RolloutGru)
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


class _Tensors(Dataset):
    """Windows as tensors, taken a batch at a time."""

    def __init__(self, windows: Windows):
        arrays = (windows.history, windows.forcing, windows.wind, windows.target, windows.path)
        self.tensors = tuple(torch.from_numpy(a) for a in arrays)

    def __len__(self) -> int:
        return len(self.tensors[0])

    def __getitem__(self, which: list[int]) -> Batch:
        return tuple(t[which] for t in self.tensors)  # type: ignore[return-value]


class _Shuffle(Sampler):
    """Batches in an order that follows from seed and epoch alone, so that a resumed run sees what it would have seen."""

    def __init__(self, count: int, batch: int, seed: int):
        self.count, self.batch, self.seed, self.epoch = count, batch, seed, 0

    def set_epoch(self, epoch: int) -> None:
        self.epoch = epoch

    def __len__(self) -> int:
        return -(-self.count // self.batch)

    def __iter__(self) -> Iterator[list[int]]:
        generator = torch.Generator().manual_seed(1_000_003 * self.seed + self.epoch)
        order = torch.randperm(self.count, generator=generator).tolist()
        return (order[k : k + self.batch] for k in range(0, self.count, self.batch))


class _Task(lightning.LightningModule):
    def __init__(self, network: nn.Module, loss: Loss, settings: FitSettings, steps: int):
        super().__init__()
        self.network, self.loss, self.settings, self.steps = network, loss, settings, steps

    def training_step(self, batch: Batch, _) -> Tensor:
        loss = self.loss(self.network, batch)
        self.log("train_loss", loss, on_step=False, on_epoch=True, batch_size=len(batch[0]))
        return loss

    def validation_step(self, batch: Batch, _) -> None:
        self.log("validation_loss", self.loss(self.network, batch), batch_size=len(batch[0]))

    def configure_optimizers(self):
        s = self.settings
        optimizer = torch.optim.AdamW(self.parameters(), lr=s.learning_rate, weight_decay=s.weight_decay)
        if not s.one_cycle:
            return optimizer
        schedule = torch.optim.lr_scheduler.OneCycleLR(
            optimizer, s.learning_rate, total_steps=self.steps, pct_start=0.15
        )
        return {"optimizer": optimizer, "lr_scheduler": {"scheduler": schedule, "interval": "step"}}


class _Report(Callback):
    """A progress bar with epochs, losses and time left, and the curves as CSV, whole after every epoch."""

    def __init__(self, title: str, epochs: int, curves: Path, quiet: bool):
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
        self.curves = curves
        self.rows: list[dict[str, float]] = []
        if curves.exists():
            with open(curves) as file:
                self.rows = [{k: float(v) for k, v in row.items()} for row in csv.DictReader(file)]

    def on_train_start(self, trainer, task) -> None:
        self.rows = [row for row in self.rows if row["epoch"] < trainer.current_epoch]
        self.progress.update(self.task, completed=trainer.current_epoch)
        self.progress.start()

    def on_train_epoch_end(self, trainer, task) -> None:
        metrics = {
            k: float(trainer.callback_metrics[k])
            for k in ("train_loss", "validation_loss")
            if k in trainer.callback_metrics
        }
        self.rows.append({"epoch": trainer.current_epoch, **metrics})
        with atomic(self.curves) as temporary, open(temporary, "w", newline="") as file:
            writer = csv.DictWriter(file, list(self.rows[-1]))
            writer.writeheader()
            writer.writerows(self.rows)
        losses = "  ".join(f"{k.split('_')[0]} {v:.4g}" for k, v in metrics.items())
        self.progress.update(self.task, advance=1, losses=losses)

    def teardown(self, trainer, task, stage) -> None:
        self.progress.stop()


def fit(
    network: nn.Module,
    loss: Loss,
    train: Windows,
    validation: Windows | None,
    settings: FitSettings,
    folder: str | Path,
    title: str = "training",
    quiet: bool = False,
) -> list[dict[str, float]]:
    """Train `network` in place and return its curves: one dict per epoch with epoch, train_loss, validation_loss.

    `folder` gets `curves.csv`, `csv/` and `tensorboard/` logs and `resume/last.ckpt`, from which a killed run of the same
    call goes on. One thread: two make such small networks 4 to 16 times slower.
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    torch.set_num_threads(1)
    network.train()
    for name in ("lightning.pytorch", "lightning.fabric"):
        logging.getLogger(name).setLevel(logging.WARNING)
    lightning.seed_everything(settings.seed, workers=True, verbose=False)
    shuffle = _Shuffle(len(train), settings.batch, settings.seed)
    task = _Task(network, loss, settings, settings.epochs * len(shuffle))
    report = _Report(title, settings.epochs, folder / "curves.csv", quiet)
    keep = ModelCheckpoint(folder / "resume", save_top_k=0, save_last=True, every_n_epochs=1)
    last = folder / "resume" / "last.ckpt"
    with warnings.catch_warnings():
        warnings.filterwarnings(
            "ignore",
            message=".*(num_workers|validation_step|dirpath|LeafSpec|litlogger|log_every_n_steps|exists and is not empty).*",
        )
        trainer = lightning.Trainer(
            accelerator="cpu",
            devices=1,
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
        trainer.fit(
            task,
            DataLoader(_Tensors(train), sampler=shuffle, batch_size=None),
            None
            if validation is None or len(validation) == 0
            else DataLoader(_Tensors(validation), sampler=_Shuffle(len(validation), 256, 0), batch_size=None),
            ckpt_path=last if last.exists() else None,
            weights_only=True,
        )
    network.eval()
    return report.rows
