"""Recorded logs into the canonical form, and what files hold."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from aspnn import records
from aspnn.checks import check_log
from aspnn.estimation.measurements import opening
from aspnn.records import Log
from aspnn.schema import InputError
from aspnn.workflow.filtering import with_noise, zone_line
from aspnn.workflow.shared import Watch, silent


def import_files(
    format: str,
    sources: Sequence[str | Path],
    out: str | Path,
    map: str | Path | None = None,
    vessel: str | None = None,
    watch: Watch = silent,
    noise: str | Path | None = None,
    mmsi: int | None = None,
) -> Iterator[tuple[Path, str]]:
    """Import recorded logs into `out`; each log's file and a line on what was dropped, gated or derived.

    `mmsi` takes one ship alone of AIS reports. `noise` is a noise file; its noise and calibration become those of the logs'
    vessel, for all that comes later.
    """
    from aspnn import logs

    if mmsi is not None and format != "ais":
        raise InputError(f"import {format}: --mmsi names a ship of AIS reports; leave it out")
    if format == "esso-osaka":
        found = logs.import_esso_osaka(sources)
    elif format == "ais":
        found = logs.import_ais(sources, vessel, mmsi)
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
