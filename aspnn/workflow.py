"""The compositions: simulate, filter, cut windows, train, evaluate. What the command line and the thin scripts call."""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from glob import glob
from pathlib import Path

import numpy as np
import pandas as pd

from aspnn import records
from aspnn.angles import difference
from aspnn.checks import check_log
from aspnn.estimation import filter_log, smooth_log
from aspnn.estimation.cascade import filter_file
from aspnn.estimation.measurements import opening
from aspnn.estimation.mounting import Alignment, align
from aspnn.estimation.noise_file import with_noise_file, write_mounting_file, write_noise_file
from aspnn.estimation.spatial import filter_spatial
from aspnn.estimation.tuning import Tuning, tune
from aspnn.frames import Zone, convergence
from aspnn.learning.config import Training, read_training
from aspnn.learning.windows import WindowSpec, write_windows
from aspnn.records import Log, States
from aspnn.schema import InputError
from aspnn.simulation.scenario import read_scenario, simulate_scenario
from aspnn.vessel import Vessel

ZONE = math.radians(3.0)  # half the width of a UTM zone
Watch = Callable[[Iterable, str, int], Iterable]  # (things, what is done, how many) -> the same things, shown


def silent(things: Iterable, what: str, count: int) -> Iterable:
    """The watch that shows nothing."""
    return things


def simulate_files(
    scenario: str | Path,
    out: str | Path,
    voyages: int | None = None,
    seed: int | None = None,
    watch: Watch = silent,
    workers: int | None = 1,
    scheduler: str | None = None,
    nmea: bool = False,
) -> list[Path]:
    """Simulate a scenario into `out`: a log and its truth per voyage, and NAME.manifest.json. Returns the logs.

    A run that was stopped goes on. `workers` and `scheduler` as in simulation.campaign.run_campaign. With `nmea` each log has its
    sentences beside it, in VOYAGE.nmea.
    """
    from aspnn.logs.nmea_write import write_nmea
    from aspnn.simulation.campaign import run_campaign

    made = run_campaign(read_scenario(scenario), out, voyages, seed, workers, scheduler, watch)
    if nmea:
        for path in watch(made, "writing sentences", len(made)):
            write_nmea(records.read_log(path), path.with_suffix(".nmea"))
    return made


def estimate_vessel(given, out: str | Path, draws: int = 60, seed: int = 0, watch: Watch = silent):
    """Write the vessel file of a ship of which only the Particulars `given` are known; its Estimate and its indices' Ranges.

    Without `draws` no range is sought. Raises InputError.
    """
    from aspnn.simulation.estimate.sureness import index_ranges
    from aspnn.simulation.estimate.vessel_file import estimate, write_vessel

    if Path(out).suffix != ".json":
        raise InputError(f"{out}: a vessel file is named .json; write --out {Path(out).stem or 'ship'}.json")
    found = estimate(given)
    ranges = index_ranges(found, draws, seed, watch) if draws else []
    write_vessel(found, out)
    return found, ranges


def filter_files(
    logs: Sequence[str | Path],
    out: str | Path,
    smooth: bool = False,
    watch: Watch = silent,
    noise: str | Path | None = None,
    tell: Callable[[str], None] = lambda line: None,
    spatial: bool = False,
) -> list[Path]:
    """Filter logs into `out` as NAME.states.parquet (and, smoothed, NAME.smoothed.parquet). Returns the state files.

    `noise` is a noise file in place of the noise and the calibration of the logs' vessel. `tell` gets a line on each log that
    lies outside its UTM zone. Logs are filtered in blocks; smoothing has the whole of one in memory, and so has filtering in
    three dimensions (`spatial`), which smooths nothing.
    """
    if spatial and smooth:
        raise InputError("--smooth is of the planar filter; leave out --spatial or --smooth")
    files = records.log_files(logs)
    tuned = None if noise is None else partial(with_noise_file, path=noise)
    made = []
    for file in watch(files, "filtering", len(files)):
        made.append(Path(out) / f"{Path(file).stem}.states.parquet")
        zone, place = (filter_spatial_file if spatial else filter_file)(file, made[-1], tuned)
        if zone is not None and abs(from_meridian(zone, place[1])) > ZONE:
            tell(f"{file}: lies outside its zone; {zone_line(zone, place)}")
        if smooth:
            log = with_noise(records.read_log(file), noise)
            records.write_states(smooth_log(log), made[-1].with_name(f"{Path(file).stem}.smoothed.parquet"))
    return made


def filter_spatial_file(
    log: str | Path, out: str | Path, tuned: Callable[[Vessel], Vessel] | None = None
) -> tuple[Zone | None, np.ndarray]:
    """Filter a log file in three dimensions into the state file `out`; as `filter_file` where not said."""
    read = records.read_log(log)
    read = read if tuned is None else replace(read, vessel=tuned(read.vessel))
    records.write_states(filter_spatial(read), out)
    middle = opening(replace(read, table=read.table.iloc[len(read) // 2 :])).place
    return read.zone, np.where(np.isnan(middle), opening(read).place, middle)


def mount_file(log: str | Path, out: str | Path | None = None, noise: str | Path | None = None) -> Alignment:
    """How the IMU of a log is mounted, written as a noise file `out` if one is named. Raises InputError for a wrong log."""
    read = with_noise(records.read_log(log), noise)
    found = align(read)
    if out is not None:
        write_mounting_file(read.vessel, found, log, out)
    return found


def from_meridian(zone: Zone, longitude: float) -> float:
    """How far east of the zone's central meridian a longitude [rad] lies, in rad."""
    return float(difference(longitude, math.radians(6 * zone.number - 183)))


def zone_line(zone: Zone, place) -> str:
    """What a zone makes of the place (latitude, longitude) [rad] in the middle of a log."""
    away = math.degrees(from_meridian(zone, place[1]))
    gamma = math.degrees(float(convergence(place[0], place[1], zone)))
    side = "east" if away >= 0 else "west"
    return f"zone {zone}: the middle of the log is {abs(away):.2f} deg {side} of the central meridian, grid convergence {gamma:+.2f} deg"


def with_noise(log: Log, noise: str | Path | None) -> Log:
    """The log of a vessel tuned by a noise file; as it is where none is named."""
    return log if noise is None else replace(log, vessel=with_noise_file(log.vessel, noise))


def tune_files(
    logs: Sequence[str | Path],
    out: str | Path,
    sensors: bool = False,
    delays: bool = False,
    heading: bool = False,
    watch: Watch = silent,
) -> Tuning:
    """Tune the noise of the one vessel of `logs` (with `delays` and `heading` its calibration too) into a noise file.

    The search starts from the vessel of the first log. Raises InputError when logs are of different vessels.
    """
    files = records.log_files(logs)
    read = [records.read_log(file) for file in watch(files, "reading", len(files))]
    first = read[0].vessel
    for file, log in zip(files, read, strict=True):
        if log.vessel.name != first.name:
            raise InputError(
                f"{file}: is of vessel {log.vessel.name}, {files[0]} of {first.name}; tune one vessel at a time"
            )
    tuning = tune(read, first, sensors, delays, heading, watch)
    write_noise_file(tuning, files, out)
    return tuning


def trial_files(
    vessel: str | Path,
    kind: str,
    rudder_deg: float | None = None,
    speed_kn: float | None = None,
    json: str | Path | None = None,
    plot: str | Path | None = None,
):
    """Run the trial `kind` (of simulation.trials.TRIALS) of a vessel; writes the JSON file and the figure where named.

    Returns the Trial. Raises InputError.
    """
    from aspnn.evaluation.trial_plot import check_suffix, trial_figure
    from aspnn.evaluation.trial_report import write_json
    from aspnn.logs.readings import KNOT
    from aspnn.simulation.trials.manoeuvres import TRIALS
    from aspnn.vessel import load_vessel

    if plot is not None:
        check_suffix(plot)
    rudder = None if rudder_deg is None else math.radians(rudder_deg)
    found = TRIALS[kind](load_vessel(vessel), rudder, None if speed_kn is None else speed_kn * KNOT)
    if json is not None:
        write_json(found, json)
    if plot is not None:
        trial_figure(found, plot)
    return found


def states_for(log: Log, *specs: WindowSpec) -> States:
    """The states of a log by the filter that networks with these specs learned from; in three dimensions if any did."""
    return filter_spatial(log) if any(spec.spatial for spec in specs) else filter_log(log)


def training_logs(training: Training, watch: Watch = silent) -> Iterator[Log]:
    """The logs of a training file, simulated or read, in a fixed order."""
    data = training.data
    if data.scenario is not None:
        scenario = read_scenario(training.folder / data.scenario)
        count = data.voyages or scenario.voyages
        yield from (log for log, _ in watch(simulate_scenario(scenario, count), "simulating", count))
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


def calibrate_files(
    checkpoint: str | Path,
    logs: Sequence[str | Path],
    out: str | Path | None = None,
    watch: Watch = silent,
):
    """Calibrate the regions of a checkpoint on logs, in place or in a copy (`out`); returns the Calibration.

    The weights stay as they are. Raises InputError for voyages that trained it, and for too few.
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

    found = calibrate(predictor, voyages(), Rule.of(bundle.vessel), [*taught(bundle), *chosen_on(bundle)])
    bundle = replace(bundle, calibration=found.to_dict())
    write_calibration(bundle, checkpoint, out or checkpoint, model_card(bundle))
    return found


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
):
    """Evaluate checkpoints beside the three baselines and, where there is truth, the oracle, on the same windows.

    A checkpoint with a choice has its network alone as a further predictor, NAME-network.

    Writes the HTML report and metrics.json where named, and returns the Evaluation. Raises InputError.
    """
    from aspnn.evaluation.evaluate import Predicts, evaluate, write_metrics
    from aspnn.evaluation.oracle import Oracle
    from aspnn.evaluation.reference import Voyage
    from aspnn.evaluation.report import write_report
    from aspnn.evaluation.windows import Rule
    from aspnn.prediction import baselines
    from aspnn.prediction.gru import GruPredictor

    files = records.log_files(logs)
    learned = [GruPredictor.load(folder) for folder in checkpoints]
    vessel = learned[0].bundle.vessel if learned else records.read_log(files[0]).vessel
    rule = Rule.of(vessel)
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
    predictors: list[Predicts] = [*learned, *networks, *baselines(vessel, rule.horizon)]
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


def consistency_files(
    logs: Sequence[str | Path],
    report: str | Path | None = None,
    metrics: str | Path | None = None,
    runs: int = 0,
    seed: int = 0,
    watch: Watch = silent,
    noise: str | Path | None = None,
):
    """Consistency of the filters on each log, with errors where its truth lies beside it, and `runs` Monte Carlo runs.

    `noise` is a noise file in place of the noise and the calibration of the logs' vessel.
    Writes the HTML page and the JSON file where named, and returns a Consistency per log. Raises InputError.
    """
    from aspnn.evaluation.consistency import consistency, write_metrics
    from aspnn.evaluation.consistency_report import write_report

    files = records.log_files(logs)
    results = []
    for file in files if runs else watch(files, "filtering", len(files)):  # one bar at a time
        log = with_noise(records.read_log(file), noise)
        results.append(consistency(log, records.read_truth(log), runs, seed, watch))
    if metrics:
        write_metrics(results, metrics)
    if report:
        write_report(results, report)
    return results


def import_files(
    format: str,
    sources: Sequence[str | Path],
    out: str | Path,
    map: str | Path | None = None,
    vessel: str | None = None,
    watch: Watch = silent,
    noise: str | Path | None = None,
) -> Iterator[tuple[Path, str]]:
    """Import recorded logs into `out`; each log's file and a line on what was dropped, gated or derived.

    `noise` is a noise file; its noise and calibration become those of the logs' vessel, for all that comes later.
    """
    from aspnn import logs

    if format == "esso-osaka":
        found = logs.import_esso_osaka(sources)
    elif format == "n2k-yacht":
        found = logs.import_n2k_yacht(sources, map, vessel)
    elif map is None:
        raise InputError(
            f"import {format}: name a map of columns, units and antennas with --map (data/maps holds examples)"
        )
    else:
        found = (logs.import_csv if format == "csv" else logs.import_nmea0183)(sources, map, vessel)
    for log in watch(found, "writing", len(found)):
        log = with_noise(log, noise)
        check_log(log, log.path or log.voyage)
        path = Path(out) / f"{log.notes['name']}.parquet"
        records.write_log(log, path)
        yield path, ", ".join(f"{key} {value}" for key, value in log.notes.items() if key != "name")


def predict_file(
    checkpoint: str | Path,
    log: str | Path,
    at: float,
    rudder: str | None,
    horizon: float | None,
    format: str,
    region_map: bool | None = None,
    fan: str | None = None,
    clear: str | None = None,
    swept: bool = False,
    soonest: bool = False,
    tell: Callable[[str], None] = lambda line: None,
) -> str:
    """The path predicted from `at` [s] of a log as text in `format` (json, geojson, csv). Raises InputError.

    `fan` predicts many orders in place of one plan (FROM:TO:STEP in degrees), `clear` judges by what is to be cleared
    (LAT,LON@METRES or FILE.geojson@METRES) and has `tell` say which order does, with `soonest` the one that is past first;
    `swept` adds the swept area.
    """
    from aspnn.prediction import Predictor, writers
    from aspnn.prediction import fan as fans

    if fan is not None and rudder is not None:
        raise InputError("--fan and --rudder exclude each other: a fan holds each of its orders; leave one of them out")
    if clear is not None and fan is None:
        raise InputError("--clear chooses among the orders of a fan; add --fan FROM:TO:STEP, such as --fan -35:35:5")
    if soonest and clear is None:
        raise InputError(
            "--soonest chooses among the orders that clear something; add --clear, such as --clear 69.65,18.96@100"
        )
    if swept and format == "csv":
        raise InputError("--swept has no form in csv; use --format json or geojson")
    orders = None if fan is None else fans.parse_fan(fan)
    predictor = Predictor.load(checkpoint)
    if region_map is not None:
        predictor = replace(predictor, region_map=region_map)
    if horizon is not None and horizon > predictor.horizon:
        raise InputError(f"--horizon {horizon:g} s is beyond the {predictor.horizon:g} s of checkpoint {checkpoint}")
    states = states_for(records.read_log(log), predictor.spec)
    last = states["time_s"][-1]
    if not states["time_s"][0] <= at <= last:
        raise InputError(
            f"{log}: --at {at:g} s is outside the log, which runs from {states['time_s'][0]:g} to {last:g} s"
        )
    now = states.until(at)
    target = None if clear is None else fans.parse_clear(clear, now.zone)
    plan = None if rudder is None else parse_plan(rudder)
    path = predictor.predict(now, plan) if orders is None else fans.fan(predictor, now, orders)
    for warning in writers.warnings(path, predictor.name):
        tell(warning)
    if horizon is not None:
        path = path.at(path.time[path.time <= horizon + 1e-9])
    if orders is not None:
        notes, chosen = fans.judged(path, orders, now, target, tell, soonest)
        if format == "csv":
            return writers.fan_csv(path, notes, now)
        if format == "geojson":
            return writers.fan_geojson(path, notes, now, predictor.name, chosen)
        return writers.fan_json(path, notes, now, predictor.name, chosen, swept)
    if format == "csv":
        return writers.to_csv(path, now)
    if format == "geojson":
        return writers.to_geojson(path, now, predictor.name, swept=swept)
    return writers.to_json(path, now, predictor.name, swept)


def export_file(checkpoint: str | Path, file: str | Path):
    """Write a checkpoint as one ONNX file; returns the learning.export.Parity of each case. Raises InputError."""
    try:
        from aspnn.learning.export import export_onnx
    except ModuleNotFoundError as error:
        raise InputError(f"export: {error.name} is not installed; pip install aspnn[export]") from None
    return export_onnx(checkpoint, file)


def parse_plan(text: str) -> list[tuple[float, float]]:
    """Rudder plan [s, rad] from text such as `20` or `20@0,-10@30` (degrees at seconds from now). Raises InputError."""
    plan = []
    for part in text.split(","):
        angle, _, when = part.partition("@")
        try:
            plan.append((float(when or 0), math.radians(float(angle))))
        except ValueError:
            raise InputError(
                f"--rudder {text!r}: {part!r} is not DEG or DEG@SECONDS, such as 20 or 20@0,-10@30"
            ) from None
    return plan


def describe(thing: str | Path) -> Iterator[str]:
    """Lines that say what a checkpoint, a log or states hold. Raises InputError."""
    path = Path(thing)
    if path.is_dir():
        from aspnn.learning.card import model_card
        from aspnn.learning.checkpoint import read_bundle

        yield from model_card(read_bundle(path)).splitlines()
        return
    table, metadata = records.read_table(path)
    record = records.read_states(path) if metadata.get("kind") == "states" else records.read_log(path)
    time = record.table["time_s"].to_numpy(float)
    step, zone = np.diff(time), record.zone or "local north and east"
    yield f"{metadata['kind']} {path}: vessel {record.vessel.name}, voyage {record.voyage}, zone {zone}"
    yield f"source: {record.source or 'not said'}; start {record.start or 'not said'}"
    yield f"{len(table)} rows over {time[-1] - time[0]:.1f} s, median step {np.median(step):.3g} s, longest gap {step.max():.3g} s"
    middle = opening(replace(record, table=record.table.iloc[len(table) // 2 :])) if isinstance(record, Log) else None
    if record.zone is not None and middle is not None and np.isfinite(middle.place).all():
        yield zone_line(record.zone, middle.place)
    for key, value in getattr(record, "notes", {}).items():
        yield f"{key}: {value}"
    for name in table.columns:
        values = table[name].to_numpy(float)
        known = np.isfinite(values)
        span = f"{values[known].min():.6g} to {values[known].max():.6g}" if known.any() else "no value"
        yield f"  {name:32s} {known.mean():7.1%} known, {span}"
