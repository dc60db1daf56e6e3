"""Commands on ships: trials, and vessel files."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from aspnn.cli.shared import Quiet, app, say, watch


class Manoeuvre(StrEnum):
    """Trials that `trial` runs."""

    turning_circle = "turning-circle"
    zigzag = "zigzag"
    williamson = "williamson"
    pull_out = "pull-out"
    spiral = "spiral"
    stopping = "stopping"


@app.command()
def trial(
    vessel: Annotated[str, typer.Argument(help="Vessel: a packaged name or a .json file.", show_default=False)],
    manoeuvre: Annotated[Manoeuvre, typer.Argument(help="Manoeuvre.", show_default=False)],
    rudder: Annotated[
        float | None, typer.Option(help="Rudder angle [deg]; without it the usual one: 35, 10 and 20, 20, 15.")
    ] = None,
    speed: Annotated[float | None, typer.Option(help="Test speed [kn]; the service speed without it.")] = None,
    json: Annotated[Path | None, typer.Option("--json", help="JSON file to write.")] = None,
    plot: Annotated[Path | None, typer.Option("--plot", help="Figure to write: .png, .svg or .pdf.")] = None,
    quiet: Quiet = False,
) -> None:
    """Run a manoeuvring trial and judge it by IMO MSC.137(76). A criterion that is not met is no error: exit code 0."""
    from aspnn.evaluation.trial_report import table
    from aspnn.workflow import trial_files

    found = trial_files(vessel, manoeuvre.value, rudder, speed, json, plot)
    say(quiet, table(found))
    for path in (json, plot):
        if path:
            say(quiet, f"written: {path}")


vessel_app = typer.Typer(help="Vessel files.", no_args_is_help=True, rich_markup_mode=None)
app.add_typer(vessel_app, name="vessel")


@vessel_app.command()
def estimate(
    length: Annotated[float, typer.Option(help="Length between perpendiculars [m].", show_default=False)],
    beam: Annotated[float, typer.Option(help="Beam [m].", show_default=False)],
    draught: Annotated[float, typer.Option(help="Draught [m].", show_default=False)],
    cb: Annotated[
        float, typer.Option(help="Block coefficient, displacement / (length x beam x draught).", show_default=False)
    ],
    out: Annotated[Path, typer.Option("--out", help="Vessel file (.json) to write.", show_default=False)],
    name: Annotated[str | None, typer.Option(help="Name of the vessel; without it the file's.")] = None,
    length_overall: Annotated[float | None, typer.Option(help="Length overall [m].")] = None,
    speed: Annotated[float | None, typer.Option(help="Service speed [kn].")] = None,
    power: Annotated[float | None, typer.Option(help="Engine power at that speed [kW].")] = None,
    rpm: Annotated[float | None, typer.Option(help="Propeller's revolutions per minute at that speed.")] = None,
    propeller_diameter: Annotated[float | None, typer.Option(help="Propeller diameter [m].")] = None,
    rudder_area: Annotated[float | None, typer.Option(help="Rudder area [m2].")] = None,
    rudder_span: Annotated[float | None, typer.Option(help="Rudder span [m].")] = None,
    draws: Annotated[int, typer.Option(help="Ships drawn to say how sure its manoeuvres are; 0 for none.", min=0)] = 60,
    seed: Annotated[int, typer.Option(help="Seed of the draws.", min=0)] = 0,
    quiet: Quiet = False,
) -> None:
    """Estimate a vessel file from main dimensions, and say how sure it is."""
    from aspnn.simulation.estimate.sureness import table, told
    from aspnn.simulation.estimate.vessel_file import KNOT, Particulars
    from aspnn.workflow import estimate_vessel, silent

    given = Particulars(
        *(length, beam, draught, cb),
        name=name or out.stem,
        length_overall=length_overall,
        speed=None if speed is None else speed * KNOT,
        power=None if power is None else power * 1e3,
        shaft=None if rpm is None else rpm / 60,
        propeller_diameter=propeller_diameter,
        rudder_area=rudder_area,
        rudder_span=rudder_span,
    )
    found, ranges = estimate_vessel(given, out, draws, seed, silent if quiet else watch)
    say(quiet, table(found))
    for line in (*(f"warning: {text}" for text in found.warnings), *told(found, ranges, draws), f"written: {out}"):
        say(quiet, line)
