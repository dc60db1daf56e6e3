"""Checkpoints against voyages: calibrated, mixed with kinematics, evaluated."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import pandas as pd

from aspnn import records
from aspnn.estimation import smooth_log
from aspnn.schema import InputError
from aspnn.workflow.filtering import states_for
from aspnn.workflow.shared import Watch, silent


def calibrate_files(
    checkpoint: str | Path,
    logs: Sequence[str | Path],
    out: str | Path | None = None,
    watch: Watch = silent,
    steered: float | None = None,
):
    """Calibrate the regions of a checkpoint on logs, in place or in a copy (`out`); returns the Calibration.

    The weights stay as they are. With `steered` [s] voyages in a closed loop among the logs, which have a start so often, calibrate a
    population of their own. Raises InputError for voyages that trained it, and for too few.
    """
    from aspnn.evaluation.calibrate import calibrate
    from aspnn.evaluation.reference import Voyage
    from aspnn.evaluation.windows import Rule
    from aspnn.learning.card import model_card
    from aspnn.learning.checkpoint import write_calibration
    from aspnn.learning.finetune import taught
    from aspnn.prediction.gru import GruPredictor

    files = records.log_files(logs)
    predictor = GruPredictor.load(checkpoint)
    bundle = predictor.bundle

    def voyages() -> Iterator[Voyage]:
        for file in watch(files, "predicting", len(files)):
            log = records.read_log(file)
            yield Voyage.of(log, states_for(log, bundle.spec), smooth_log)

    rule = replace(Rule.of(bundle.vessel), steered_every=_positive(steered))
    found = calibrate(predictor, voyages(), rule, [*taught(bundle), *chosen_on(bundle)])
    bundle = replace(bundle, calibration=found.to_dict())
    write_calibration(bundle, checkpoint, out or checkpoint, model_card(bundle))
    return found


def _positive(steered: float | None) -> float | None:
    if steered is not None and not steered > 0:
        raise InputError(f"--steered {steered:g}: give the seconds between starts, above 0")
    return steered


def choose_files(
    checkpoint: str | Path,
    logs: Sequence[str | Path],
    out: str | Path | None = None,
    tell: Callable[[str], None] = lambda line: None,
    watch: Watch = silent,
):
    """Fix on logs what a checkpoint leaves to kinematics, in place or in a copy (`out`); returns the HybridChoice.

    The weights stay as they are. A calibration, made without this choice, goes, which `tell` gets a line on. Where kinematics are
    nowhere better nothing is written. Raises InputError for voyages that trained it, and for too few.
    """
    from aspnn.evaluation.choose import choose
    from aspnn.evaluation.reference import Voyage
    from aspnn.evaluation.windows import Rule
    from aspnn.learning.card import model_card
    from aspnn.learning.checkpoint import read_bundle, write_choice
    from aspnn.learning.finetune import taught
    from aspnn.prediction.gru import GruPredictor

    files = records.log_files(logs)
    bundle = read_bundle(checkpoint)
    network = GruPredictor(replace(bundle, choice=None, calibration=None), bundle.region_map)

    def voyages() -> Iterator[Voyage]:
        for file in watch(files, "predicting", len(files)):
            log = records.read_log(file)
            yield Voyage.of(log, states_for(log, bundle.spec), smooth_log)

    found = choose(network, voyages(), Rule.of(bundle.vessel), taught(bundle))
    if found.idle and bundle.choice is None:
        tell(f"{checkpoint}: kinematics are nowhere better than the network; nothing was written")
        return found
    if bundle.calibration is not None:
        tell(
            f"{bundle.name}: its regions were calibrated without this choice and are dropped; run `aspnn calibrate` again"
        )
    bundle = replace(bundle, choice=None if found.idle else found.to_dict(), calibration=None)
    write_choice(bundle, checkpoint, out or checkpoint, model_card(bundle))
    return found


def chosen_on(bundle) -> list[str]:
    """The voyages that the choice of a checkpoint was fixed on."""
    return list((bundle.choice or {}).get("facts", {}).get("voyages", ()))


def evaluate_files(
    checkpoints: Sequence[str | Path],
    logs: Sequence[str | Path],
    report: str | Path | None = None,
    metrics: str | Path | None = None,
    seed: int = 0,
    oracle: bool = True,
    watch: Watch = silent,
    steered: float | None = None,
    track: bool = False,
):
    """Evaluate checkpoints beside the three baselines and, where there is truth, the oracle, on the same windows.

    A checkpoint with a choice has its network alone as a further predictor, NAME-network. With `steered` [s] there is a start so often
    too, whatever is ordered, as voyages under an autopilot need. With `track` each has itself beside it, corrected by what the
    voyage tells of its ship, NAME-tracked.

    Writes the HTML report and metrics.json where named, and returns the Evaluation. Raises InputError.
    """
    from aspnn.evaluation.evaluate import Predicts, evaluate, write_metrics
    from aspnn.evaluation.oracle import Oracle
    from aspnn.evaluation.reference import Voyage
    from aspnn.evaluation.report import write_report
    from aspnn.evaluation.windows import Rule
    from aspnn.prediction import baselines
    from aspnn.prediction.gru import GruPredictor
    from aspnn.prediction.tracked import Tracked

    files = records.log_files(logs)
    learned = [GruPredictor.load(folder) for folder in checkpoints]
    vessel = learned[0].bundle.vessel if learned else records.read_log(files[0]).vessel
    rule = replace(Rule.of(vessel), steered_every=_positive(steered))
    shortest = min(learned, key=lambda p: p.horizon, default=None)
    if shortest is not None:  # a boat's predictor does not reach as far as a model ship's
        rule = replace(rule, horizons=tuple(h for h in rule.horizons if h <= shortest.horizon + 1e-9))
        if not rule.horizons:
            raise InputError(
                f"checkpoint {shortest.name} predicts {shortest.horizon:g} s, this evaluation needs {min(Rule.of(vessel).horizons):g} s"
            )

    names: set[str] = set()

    def voyages() -> Iterator[Voyage]:
        for file in watch(files, "evaluating", len(files)):
            log = records.read_log(file)
            names.add(log.voyage)
            yield Voyage.of(log, states_for(log, *(predictor.spec for predictor in learned)), smooth_log)

    networks = [p.alone for p in learned if p.choice is not None]
    followed = [Tracked(p) for p in learned] if track else []
    predictors: list[Predicts] = [*learned, *followed, *networks, *baselines(vessel, rule.horizon)]
    result = evaluate(predictors, voyages(), rule, seed, Oracle.of if oracle else None)
    result = replace(result, warnings=tuple(line for p in learned for line in _leaks(p.bundle, names)))
    if metrics:
        write_metrics(result, metrics)
    if report:
        write_report(result, report, training_curves(checkpoints), _notes(learned))
    return result


def _leaks(bundle, names: set[str]) -> Iterator[str]:
    """A line on test voyages that a checkpoint was trained or validated on: its figures would flatter it."""
    taught = names & {*bundle.provenance["training_voyages"], *bundle.provenance["validation_voyages"]}
    if taught:
        some = ", ".join(sorted(taught)[:3]) + (", ..." if len(taught) > 3 else "")
        yield f"{len(taught)} of {len(names)} voyages taught {bundle.name} ({some}); its errors on them say nothing of new ones"
    chosen = names & {*chosen_on(bundle)}
    if chosen:
        some = ", ".join(sorted(chosen)[:3]) + (", ..." if len(chosen) > 3 else "")
        yield f"the choice of {bundle.name} was fixed on {len(chosen)} of {len(names)} voyages ({some}); its errors on them flatter it"
    measured = names & {*(bundle.calibration or {}).get("facts", {}).get("voyages", ())}
    if measured:
        some = ", ".join(sorted(measured)[:3]) + (", ..." if len(measured) > 3 else "")
        yield f"{len(measured)} of {len(names)} voyages calibrated {bundle.name} ({some}); the coverage of its regions on them flatters it"


def training_curves(checkpoints: Sequence[str | Path]) -> dict[str, pd.DataFrame]:
    """The training curves that lie beside checkpoints still in their run folder, by run and network."""
    found = {}
    for checkpoint in checkpoints:
        for file in sorted(Path(checkpoint).parent.glob("*/curves.csv")):
            found[f"{file.parent.parent.name} {file.parent.name}"] = pd.read_csv(file)
    return found


def _notes(learned) -> dict[str, str]:
    return {
        f"checkpoint {p.name}": f"seed {p.bundle.provenance['training']['fit']['seed']}, data {p.bundle.provenance['data_sha256'][:12]}"
        for p in learned
    }
