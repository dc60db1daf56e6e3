"""Noise files: what tuning or a mounting's calibration found for a vessel, with how sure it is and from which logs, as JSON."""

import json
import math
from collections.abc import Sequence
from dataclasses import replace
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from aspnn import __version__, records
from aspnn.estimation.mounting import Alignment
from aspnn.estimation.tuning import Tuning
from aspnn.instruments import (
    CALIBRATION_KEYS,
    NOISE_KEYS,
    calibration_data,
    noise_data,
    read_calibration,
    read_mounting,
    read_noise,
    read_spatial,
)
from aspnn.schema import InputError
from aspnn.vessel import Vessel

KEYS = ("vessel", "sensors", "process", "calibration", "imu", "spatial", "provenance")
FIELDS = {  # section.key: field of Noise or Calibration
    **{f"{section}.{key}": name for section, keys in NOISE_KEYS.items() for key, name in keys.items()},
    **{f"calibration.{key}": name for key, (name, _, _) in CALIBRATION_KEYS.items()},
}


def flat(vessel: Vessel) -> dict[str, float]:
    """Noise and calibration by `section.key`, in the units that the key names."""
    sections = {**noise_data(vessel.noise), "calibration": calibration_data(vessel.calibration)}
    return {f"{section}.{key}": value for section, values in sections.items() for key, value in values.items()}


def errors(tuning: Tuning) -> dict[str, float]:
    """Standard errors of what was estimated, by `section.key`, in the units that the key names."""
    return {
        key: math.degrees(tuning.errors[name]) if "_deg" in key else tuning.errors[name]
        for key, name in FIELDS.items()
        if name in tuning.errors
    }


def notes(tuning: Tuning) -> dict[str, str]:
    """Why values stayed as they were, by `section.key`."""
    return {key: tuning.notes[name] for key, name in FIELDS.items() if name in tuning.notes}


def write_noise_file(tuning: Tuning, logs: Sequence[str | Path], path: str | Path) -> None:
    """Write what tuning on the files `logs` found, whole or not at all."""
    data: dict[str, Any] = {
        "vessel": tuning.vessel.name,
        **noise_data(tuning.vessel.noise),
        "calibration": calibration_data(tuning.vessel.calibration),
        "provenance": {
            "version": __version__,
            "logs": [{"name": Path(log).name, "sha256": records.sha256(log)} for log in logs],
            "log_likelihood_per_epoch": {"before": tuning.before, "after": tuning.after},
            "standard_errors": errors(tuning),
            "notes": notes(tuning),
        },
    }
    with records.atomic(path) as temporary:
        temporary.write_text(json.dumps(data, indent=1) + "\n")


def write_mounting_file(vessel: Vessel, alignment: Alignment, log: str | Path, path: str | Path) -> None:
    """Write the mounting of an IMU that the file `log` told, whole or not at all; `--noise` takes it."""
    data: dict[str, Any] = {
        "vessel": vessel.name,
        "imu": alignment.section(),
        "provenance": {
            "version": __version__,
            "logs": [{"name": Path(log).name, "sha256": records.sha256(log)}],
            "standard_errors_deg": [math.degrees(error) for error in alignment.errors],
            "not_observed": list(alignment.unseen),
        },
    }
    with records.atomic(path) as temporary:
        temporary.write_text(json.dumps(data, indent=1) + "\n")


def table(tuning: Tuning):
    """A rich table of the values before and after, with standard errors and why some stayed."""
    from rich.table import Table

    show = Table(title=f"vessel {tuning.vessel.name}")
    for name in ("value", "before", "after", "standard error", "remark"):
        show.add_column(name, justify="left" if name in ("value", "remark") else "right")
    before, after, sure, why = flat(tuning.start), flat(tuning.vessel), errors(tuning), notes(tuning)
    for key, value in after.items():
        error = f"{sure[key]:.2g}" if key in sure else ""
        remark = why.get(key, "" if key in sure else "not sought")
        show.add_row(key, f"{before[key]:.4g}", f"{value:.4g}", error, remark)
    return show


def with_noise_file(vessel: Vessel, path: str | Path) -> Vessel:
    """`vessel` with the noise, the calibration and the mounting of the IMU of a noise file; what the file does not name stays.

    Raises InputError naming the file, when it cannot be read, is for another vessel or holds what a vessel cannot have.
    """
    try:
        data = json.loads(Path(path).read_text())
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); `aspnn tune` writes noise files") from None
    except ValueError as error:
        raise InputError(f"{path}: not JSON ({error})") from None
    if not isinstance(data, dict):
        raise InputError(f"{path}: a noise file holds one JSON object")
    for key, value in data.items():
        if key not in KEYS:
            near = get_close_matches(key, KEYS, 1)
            raise InputError(f"{path}: key {key} is not known{f', did you mean {near[0]}?' if near else ''}")
        if key != "vessel" and not isinstance(value, dict):
            raise InputError(f"{path}: {key} must be an object of named values")
    if data.get("vessel") != vessel.name:
        raise InputError(
            f"{path}: is for vessel {data.get('vessel')}, not for {vessel.name}; tune on logs of this vessel"
        )
    noise = read_noise(data, vessel.noise, str(path))
    calibration = read_calibration(data, str(path)) if "calibration" in data else vessel.calibration
    mounting = read_mounting(data, str(path)) if "imu" in data else vessel.mounting
    spatial = read_spatial(data, str(path)) if "spatial" in data else vessel.spatial
    return replace(vessel, noise=noise, calibration=calibration, mounting=mounting, spatial=spatial)
