"""The model card of a checkpoint, rendered from what it was made of."""

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
        "training": f"{training['fit']['epochs']} epochs of batches of {training['fit']['batch']}, seed {training['fit']['seed']}",
        "made by": f"`aspnn train training/{bundle.name}.toml`, aspnn {facts['aspnn']}, torch {facts['torch']}",
    }
    if bundle.calibration is not None:
        counts = bundle.calibration["facts"]["populations"]
        of = ", ".join(f"{name} {count['windows']}" for name, count in counts.items())
        rows["regions"] = f"calibrated on {len(bundle.calibration['facts']['voyages'])} other voyages; windows {of}"
    source = training["data"]["scenario"] or ", ".join(training["data"]["logs"])
    rows["trained on"] = f"{source}: {rows['trained on']}"
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

## Limits

Decision support, not type-approved. It knows this vessel in this loading, in the water and weather of its data; it knows
nothing of other ships or the shore. `aspnn evaluate` measures it on your own logs.
"""
