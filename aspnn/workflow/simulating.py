"""Scenarios, trials and vessel files to disk."""

import math
from collections.abc import Callable
from pathlib import Path

from aspnn import records
from aspnn.schema import InputError
from aspnn.simulation.scenario import read_scenario
from aspnn.workflow.shared import Watch, silent


def simulate_files(
    scenario: str | Path,
    out: str | Path,
    voyages: int | None = None,
    seed: int | None = None,
    watch: Watch = silent,
    workers: int | None = 1,
    scheduler: str | None = None,
    nmea: bool = False,
    tell: Callable[[str], None] = lambda line: None,
) -> list[Path]:
    """Simulate a scenario into `out`: a log and its truth per voyage, and NAME.manifest.json. Returns the logs.

    A run that was stopped goes on. `workers` and `scheduler` as in simulation.campaign.run_campaign. With `nmea` each log has its
    sentences beside it, in VOYAGE.nmea. `tell` gets a line on the voyages whose helm asked for what the ship could not follow.
    """
    from aspnn.logs.nmea_write import write_nmea
    from aspnn.simulation.campaign import run_campaign

    given = read_scenario(scenario)
    made = run_campaign(given, out, voyages, seed, workers, scheduler, watch)
    if nmea:
        for path in watch(made, "writing sentences", len(made)):
            write_nmea(records.read_log(path), path.with_suffix(".nmea"))
    if not hasattr(given.manoeuvre, "steering"):
        return made
    lost = [(path, note) for path in made if (note := records.read_blocks(path, 1)[0].notes.get("steering"))]
    if lost:
        tell(f"{lost[0][0]}: {lost[0][1]}{f' (and {len(lost) - 1} more voyages)' if len(lost) > 1 else ''}")
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
