"""Commands on the bridge: live sentences in, the page and predictions out, and a simulated ship to try it on."""

from pathlib import Path
from typing import Annotated

import typer

from aspnn.cli.shared import Quiet, app

Model = Annotated[
    Path | None, typer.Argument(help="Checkpoint folder or exported .onnx file of the ship.", show_default=False)
]


@app.command()
def serve(
    config: Annotated[
        Path, typer.Option("--config", help="Settings of the bridge (data/maps/bridge.toml).", show_default=False)
    ],
    checkpoint: Model = None,
    expose: Annotated[
        bool,
        typer.Option(
            "--expose", help="Let other computers in, as the settings say ([server] host and token, [share] interface)."
        ),
    ] = False,
    quiet: Quiet = False,
) -> None:
    """Predict live from a ship's sentences and serve the page; without a checkpoint the rate-of-turn arc alone. Ctrl-C ends it."""
    from aspnn.live.start import run

    run(config, checkpoint, expose, quiet)


@app.command()
def bridge(
    scenario: Annotated[Path, typer.Argument(help="Scenario file (data/scenarios/harbour.toml).", show_default=False)],
    checkpoint: Model = None,
    port: Annotated[int, typer.Option(help="Port of the page on this computer.", min=1, max=65535)] = 8765,
    chart: Annotated[
        Path | None, typer.Option(help="Chart (GeoJSON) in place of the scenario's.", show_default=False)
    ] = None,
    record: Annotated[
        Path | None, typer.Option(help="Folder that keeps log, states and predictions.", show_default=False)
    ] = None,
    share: Annotated[
        str | None,
        typer.Option(help="Multicast group GROUP:PORT on which simulated ships share predictions.", show_default=False),
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Steer a simulated ship live on the page; chart, checkpoint and other ships are the scenario's. Ctrl-C ends it."""
    from aspnn.live.start import run_bridge

    run_bridge(scenario, checkpoint, port, chart, quiet, record, share)
