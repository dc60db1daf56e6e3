"""Sections of a vessel file, read strictly: every coefficient known by name, present, and of a size that a ship can have."""

import math
from collections.abc import Mapping
from difflib import get_close_matches

from aspnn.schema import InputError
from aspnn.vessel import Vessel

Bounds = Mapping[str, tuple[float, float]]  # of each coefficient, the least and the greatest value a ship can have


def coefficients(
    vessel: Vessel, section: str, bounds: Bounds, default: Mapping[str, float] | None = None
) -> dict[str, float]:
    """The numbers of `section`, by name; those of `default` may be missing there.

    Raises InputError naming the vessel and the coefficient that is unknown (with the nearest known one), missing, no number, or
    outside its `bounds`, which is how a value in the wrong unit shows.
    """
    default, data = default or {}, vessel.simulator.get(section, {})
    for name in data:
        if name not in bounds:
            near = get_close_matches(name, bounds, 1)
            hint = f"did you mean {near[0]}?" if near else f"known: {', '.join(bounds)}"
            raise InputError(f"{vessel.label}: {section}.{name} is not known, {hint}")
    found = {}
    for name, (low, high) in bounds.items():
        value = data.get(name, default.get(name))
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise InputError(f"{vessel.label}: {section}.{name} is missing or not a number")
        if not low <= value <= high:
            raise InputError(
                f"{vessel.label}: {section}.{name} = {value:g} is outside {low:g} to {high:g}; check its unit and sign"
            )
        found[name] = float(value)
    return found
