"""The model card of a checkpoint, rendered from what it was made of."""

from typing import Any

from aspnn.learning.checkpoint import Bundle


def model_card(bundle: Bundle) -> str:
    """The model card (Markdown) of a bundle, from what it was made of; nothing in it is written by hand."""
    spec, facts = bundle.spec, bundle.provenance
    training = facts["training"]
    domain = "\n".join(f"| {name} | {low:.4g} | {high:.4g} |" for name, (low, high) in bundle.domain.items())
    path = "region-mapped pivot point (Paper V, table 4)" if bundle.region_map else "exact rigid-body step"
    bow, stern = bundle.vessel.sway_stations
    rows = {
        "vessel": f"{bundle.vessel.name} ({bundle.vessel.title}), {bundle.vessel.length:g} x {bundle.vessel.beam:g} m",
        "predicts": f"surge, sway at x = {bow:g} m and at x = {stern:g} m; {spec.horizon:g} s ahead, every {spec.period:g} s",
        "sees": f"{spec.history:g} s of {', '.join(spec.inputs)}",
        "plan": ", ".join(spec.forcings) or "the new order, as the last row of the history",
        "path": path,
        "network": f"{training['network']['kind']}, {sum(p.numel() for p in bundle.network.parameters())} weights",
        "trained on": f"{len(facts['training_voyages'])} voyages, {facts['training_windows']} windows",
        "validated on": f"{len(facts['validation_voyages'])} other voyages, {facts['validation_windows']} windows",
        "training": f"batches of {training['fit']['batch']}, seed {training['fit']['seed']}",
        "made by": f"`aspnn train training/{bundle.name}.toml`, aspnn {facts['aspnn']}, torch {facts['torch']}",
    }
    if spec.spatial:
        rows["sees"] += ", from the filter in three dimensions"
    if spec.course_only:
        rows["sees"] += ", from positions alone (course filter)"
    if spec.current_memory is not None:
        rows["current"] = f"sought in the last {spec.current_memory:g} s"
    if (parent := facts.get("parent")) is not None:
        rows["made by"] = rows["made by"].replace(".toml`", f".toml --from {parent['name']}`")
        rows["fine-tuned from"] = (
            f"{parent['name']} of {parent['vessel']} (SHA-256 {parent['model_sha256'][:12]}): weights and scaling; no regions or choice"
        )
    if bundle.calibration is not None:
        counts = bundle.calibration["facts"]["populations"]
        of = ", ".join(f"{name} {count['windows']}" for name, count in counts.items())
        rows["regions"] = f"calibrated on {len(bundle.calibration['facts']['voyages'])} other voyages; windows {of}"
    if bundle.choice is not None:
        kinematic, count = bundle.choice["kinematic"], len(bundle.choice["facts"]["voyages"])
        rows["choice"] = f"mixed with {kinematic} where that is better; fixed on {count} other voyages"
    if bundle.servos is not None:
        rows |= bundle.servos.lines()
    data = training["data"]
    source = data["scenario"] or ", ".join(data.get("scenarios") or data["logs"])
    rows["trained on"] = f"{source}: {rows['trained on']}"
    rows["training"] = f"{_epochs(facts, training)}{rows['training']}"
    table = "\n".join(f"| {name} | {value} |" for name, value in rows.items())
    return f"""# {bundle.name}

{training["about"]}

| | |
|---|---|
{table}

## Where it has been

Outside this range of inputs (SI units, radians) the network extrapolates.

| input | lowest | highest |
|---|---|---|
{domain}
{_curves(facts)}
## Limits

Decision support, not type-approved. It knows this vessel in this loading, in the water and weather of its data; it knows
nothing of other ships or the shore. `aspnn evaluate` measures it on your own logs.
"""


def _epochs(facts: dict[str, Any], training: dict[str, Any]) -> str:
    """The epochs of every network in turn; a checkpoint that was made without its curves knows only those of its file."""
    counts = {name: len(next(iter(curve.values()), ())) for name, curve in facts.get("curves", {}).items()}
    if len(counts) < 2:
        return f"{training['fit']['epochs']} epochs of "
    return f"{', then '.join(f'{count} epochs ({name})' for name, count in counts.items())}, of "


def _curves(facts: dict[str, Any]) -> str:
    """How the losses fell, a row per network and curve: after its first, its middle and its last epoch, and at the lowest."""
    if not facts.get("curves"):
        return ""
    lines = [
        "",
        "## How it learned",
        "",
        "| network | loss | first epoch | middle | last | lowest |",
        "|---|---|---|---|---|---|",
    ]
    for name, curve in facts["curves"].items():
        for loss, values in curve.items():
            shown = values[0], values[len(values) // 2], values[-1]
            cells = " | ".join(f"{value:.4g}" for value in shown)
            lowest = min(range(len(values)), key=values.__getitem__)
            lines.append(
                f"| {name} | {loss.removesuffix('_loss')} | {cells} | {values[lowest]:.4g} (epoch {lowest + 1}) |"
            )
    return "\n".join([*lines, ""])
