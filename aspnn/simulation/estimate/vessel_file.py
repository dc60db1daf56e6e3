"""A vessel file for a ship of which only the main dimensions are known, with the standard deviation of every coefficient."""

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from aspnn.records import atomic
from aspnn.schema import InputError
from aspnn.simulation.estimate import bseries, regression
from aspnn.simulation.estimate.propulsion import AREA, BLADES, Screw, ServicePoint, service_point
from aspnn.simulation.estimate.regression import Hull
from aspnn.simulation.estimate.resistance import GRAVITY, Form
from aspnn.simulation.ship import Ship
from aspnn.vessel import from_dict

KNOT = 1852 / 3600  # m/s
RHO = 1025.0  # kg/m3
USUAL = {  # where the ships of the formulas lie (assumed; the papers' own ranges were not opened), and where any ship does
    "block coefficient": ((0.50, 0.86), (0.30, 0.90)),
    "length over beam": ((4.5, 8.0), (2.5, 12.0)),
    "beam over draught": ((2.1, 4.5), (1.2, 12.0)),
    "Froude number": ((0.10, 0.32), (0.02, 0.40)),
}
ASSUMED = {  # relative standard deviations of what no known ship tells
    "R_0": (0.15, "assumed: on cargo90 Holtrop's resistance is 16 % less than its engine's power says"),
    "C1": (0.2, "assumed"),
    "C2_plus": (0.2, "assumed"),
    "C2_minus": (0.2, "assumed"),
    "k0": (0.05, "assumed"),
    "k1": (0.05, "assumed"),
    "k2": (0.05, "assumed"),
    "f_alpha": (0.05, "assumed"),
}
GUESSED = {"D_P": 0.07, "H_R": 0.10, "A_R": 0.15}  # relative, where the user does not tell them (assumed)
OFFSET = "what the formula misses of KVLCC2, the one ship that tells it"
KVLCC2S = "KVLCC2's (Yasukawa and Yoshimura 2015)"
CORRECTED = "Yoshimura and Masumoto 2012 in v-form, plus what it misses of KVLCC2"
FORMULAS = {
    "m_x": "0.05 m (Sukas, Kinaci and Bal 2019)",
    "m_y": "Zhou et al. 1983 on Motora's charts, as in MANSIM (Sukas, Kinaci and Bal 2019)",
    "J_z": "Zhou et al. 1983 on Motora's charts, as in MANSIM (Sukas, Kinaci and Bal 2019)",
    "kzz": "0.25, KVLCC2's (Yasukawa and Yoshimura 2015)",
    "w_P0": "0.5 C_b - 0.05 (Taylor)",
    "t_P": "assumed",
    "a_H": "0.627 C_b - 0.153 (Quadvlieg 2013), plus what it misses of KVLCC2",
    "epsilon": "2.26 - 1.82 (1 - w_P0) (Yoshimura and Masumoto 2012), plus what it misses of KVLCC2",
    "kappa": "0.55 - 0.8 C_b B/L (Yoshimura and Masumoto 2012), plus what it misses of KVLCC2",
    "gamma_R": "2.06 C_b B/L + 0.14 (Yoshimura and Masumoto 2012), plus what it misses of KVLCC2; half of KVLCC2's split (assumed)",
    "f_alpha": "6.13 a / (a + 2.25), a = H_R^2 / A_R (Fujii)",
    **dict.fromkeys(("t_R", "x_H", "l_R", "x_P", "x_R", "C1", "C2_plus", "C2_minus"), KVLCC2S),
}


@dataclass(frozen=True)
class Particulars:
    """What is known of a ship; SI. `length` is between perpendiculars; what is None `estimate` fills in."""

    length: float
    beam: float
    draught: float
    block: float
    name: str = "estimated"
    length_overall: float | None = None
    speed: float | None = None  # m/s, in service
    power: float | None = None  # W, of the engine at that speed
    shaft: float | None = None  # rev/s at that speed
    propeller_diameter: float | None = None
    rudder_area: float | None = None
    rudder_span: float | None = None

    @property
    def hull(self) -> Hull:
        return Hull(self.length, self.beam, self.draught, self.block * self.length * self.beam * self.draught)


@dataclass(frozen=True)
class Estimate:
    """The data of a vessel file; standard deviation and reason of the coefficients of `mmg`; warnings; the service point."""

    data: dict[str, Any]
    deviations: dict[str, tuple[float, str]]
    warnings: tuple[str, ...]
    service: ServicePoint


def estimate(given: Particulars) -> Estimate:
    """A complete vessel file from main dimensions. Raises InputError, naming the option, for what no ship is."""
    hull = given.hull
    speed, speed_source = given.speed, "given"
    if speed is None:
        speed = min(max((1.08 - given.block) / 1.68, 0.12), 0.30) * math.sqrt(GRAVITY * given.length)
        speed_source = (
            "Froude number (1.08 - C_b) / 1.68, the usual one for this block coefficient (design rule), 0.12 to 0.30"
        )
    D = given.propeller_diameter or min(max(0.475 + 1.2 * (0.81 - given.block), 0.45), 0.80) * given.draught
    span = given.rudder_span or max(0.70 * given.draught, 1.15 * D)
    area = given.rudder_area or hull.Lpp * hull.d / 100 * (1 + 50 * (hull.C_b * hull.B / hull.Lpp) ** 2)
    warnings = _checked(given, speed, D, span)
    values = regression.corrected(hull)
    values["f_alpha"] = 6.13 * (span * span / area) / (span * span / area + 2.25)
    inflow = (1 - values["w_P0"]) * speed
    form = Form.of(hull.Lpp, hull.B, hull.d, hull.C_b)
    point = service_point(form, speed, values["t_P"], Screw(D, inflow, RHO), given.power, given.shaft)
    values["R_0"] = (1 - values["t_P"]) * point.thrust / (0.5 * RHO * hull.Lpp * hull.d * speed**2)
    values["k0"], values["k1"], values["k2"] = bseries.thrust_quadratic(point.pitch, AREA, BLADES)
    values |= {"rho": RHO, "Lpp": hull.Lpp, "B": hull.B, "d": hull.d, "nabla": hull.nabla, "C_b": hull.C_b, "x_G": 0.0}
    values |= {"D_P": D, "H_R": span, "A_R": area}
    deviations = _deviations(given, values)
    ship = regression.type_ship().measured
    mean, split = values.pop("gamma_R"), (ship["gamma_R_plus"] - ship["gamma_R_minus"]) / 4
    values |= {"gamma_R_plus": mean + split, "gamma_R_minus": mean - split}
    propeller = f"Wageningen B{BLADES}-{AREA * 100:.0f} (assumed), polynomials of Oosterveld and van Oossanen 1975; P/D {point.choice}"
    reasons = dict.fromkeys((name for name in values if name[:2] in ("X_", "Y_", "N_")), CORRECTED)
    reasons |= dict.fromkeys(regression.LINEAR, CORRECTED + ", half of it (weight chosen, not measured)")
    reasons |= FORMULAS | {"R_0": point.balance, **dict.fromkeys(("k0", "k1", "k2"), propeller)}
    reasons |= {
        "D_P": "given"
        if given.propeller_diameter
        else "assumed: 0.475 + 1.2 (0.81 - C_b) of the draught, 0.45 to 0.80 (KVLCC2 0.474, KCS 0.735, S-175 0.769)",
        "H_R": "given" if given.rudder_span else "assumed: 0.70 of the draught (KVLCC2 0.76), at least 1.15 D_P",
        "A_R": "given" if given.rudder_area else "L d / 100 (1 + 50 C_b^2 (B/L)^2) (Det Norske Veritas, recalled)",
    }
    overall = given.length_overall or 1.04 * given.length
    data = {
        "name": given.name,
        "title": f"{given.name}: estimated from its dimensions, nothing measured",
        "dimensions": {"length_overall_m": overall, "beam_m": given.beam, "draught_m": given.draught},
        "stations_m": {"bow": [0.4 * hull.Lpp, 0.0], "stern": [-0.4 * hull.Lpp, 0.0], "imu": [0.0, 0.0]},
        "rudder": {"max_deg": 35.0, "rate_deg_s": 2.32},
        "service": {"speed_m_s": speed},
        "mmg": {name: float(f"{value:.10g}") for name, value in values.items()},
        "propeller": {"pitch_ratio": float(f"{point.pitch:.10g}")},
        "wind": {
            "A_F": 160.0 * (given.beam / 14) ** 2,
            "A_L": 480.0 * overall / 90 * given.beam / 14,
            "CDt": 0.85,
            "CDl_0": 0.65,
            "CDl_pi": 0.55,
            "delta": 0.40,
            "kappa": 1.7,
            "s_L": -4.0 * overall / 90,
        },
        "sources": {
            "dimensions": "given"
            if given.length_overall
            else "given; length overall assumed: 1.04 of that between perpendiculars",
            "stations_m": "assumed: antennas 0.4 of the length before and abaft midship, IMU at midship",
            "rudder": "assumed: 35 deg, and 65 deg in 28 s (SOLAS II-1/29)",
            "service": speed_source,
            "mmg": "estimated by aspnn from length, beam, draught and block coefficient; nothing measured. Each coefficient below",
            "mmg.rho": "sea water",
            **dict.fromkeys(("mmg.Lpp", "mmg.B", "mmg.d", "mmg.C_b"), "given"),
            "mmg.nabla": "C_b L B d",
            "mmg.x_G": "assumed: midship",
            **_told(reasons, deviations, values),
            "propeller": f"{propeller}; right-handed (assumed)",
            "wind": "Blendermann 1994, cargo vessel, loaded; areas assumed: those of cargo90 by the beam and the length",
        },
    }
    return Estimate(data, deviations, warnings, point)


def write_vessel(found: Estimate, path: str | Path) -> None:
    """Write the vessel file, atomically, when it is one that can be simulated. Raises InputError."""
    Ship.of(from_dict(found.data, str(path)))
    with atomic(path) as temporary:
        Path(temporary).write_text(json.dumps(found.data, indent=1) + "\n")


def _checked(given: Particulars, speed: float, D: float, span: float) -> tuple[str, ...]:
    """Warnings where the ship is unlike those of the formulas. Raises InputError for what no ship is."""
    middle = given.length * given.draught
    for option, value, low, high in (
        ("--length", given.length, 2.0, 500.0),
        ("--beam", given.beam, 0.3, 90.0),
        ("--draught", given.draught, 0.05, 30.0),
        ("--cb", given.block, *USUAL["block coefficient"][1]),
        ("--length-overall", given.length_overall, given.length * 0.97, given.length * 1.25),
        ("--power", given.power, 1.0, 1.2e8),
        ("--rpm", None if given.shaft is None else given.shaft * 60, 10.0, 3000.0),
        ("--propeller-diameter", D, 0.1 * given.draught, 1.2 * given.draught),
        ("--rudder-span", span, D, 1.3 * given.draught),
        ("--rudder-area", given.rudder_area, 0.003 * middle, 0.1 * middle),
    ):
        if value is not None and not low <= value <= high:
            raise InputError(f"{option} {value:g} is outside {low:.4g} to {high:.4g} for this ship; check its unit")
    ratios = {
        "block coefficient": given.block,
        "length over beam": given.length / given.beam,
        "beam over draught": given.beam / given.draught,
        "Froude number": speed / math.sqrt(GRAVITY * given.length),
    }
    lines = []
    for what, value in ratios.items():
        (low, high), (least, most) = USUAL[what]
        if not least <= value <= most:
            raise InputError(
                f"{what} {value:.3g} is outside {least:g} to {most:g}, so no formula here holds; check the dimensions"
            )
        if not low <= value <= high:
            lines.append(
                f"{what} {value:.3g} is outside {low:g} to {high:g}, where the formulas' ships lie: less sure than told"
            )
    return tuple(lines)


def _deviations(given: Particulars, values: dict[str, float]) -> dict[str, tuple[float, str]]:
    """Standard deviation of each coefficient, and on what ships it was found."""
    found = {
        name: (regression.deviation(name), "error on " + ", ".join(off))
        for name, off in regression.errors().items()
        if name in values
    }
    found |= {name: (part * abs(values[name]), why) for name, (part, why) in ASSUMED.items()}
    ship = regression.type_ship()
    raw = regression.hull_formulas(ship.hull, ship.measured["m_x"], ship.measured["m_y"])
    found["X_vvvv"] = (abs(ship.measured["X_vvvv"] - raw["X_vvvv"]), OFFSET)
    told = {"D_P": given.propeller_diameter, "H_R": given.rudder_span, "A_R": given.rudder_area}
    return found | {name: (GUESSED[name] * values[name], "assumed") for name, value in told.items() if value is None}


def _told(
    reasons: dict[str, str], deviations: dict[str, tuple[float, str]], values: dict[str, float]
) -> dict[str, str]:
    """`sources` of the coefficients: formula, standard deviation and what tells it."""
    lines = {}
    for name in values:
        key = "gamma_R" if name.startswith("gamma_R") else name
        if key in reasons:
            sure = "; fixed"
            if key in deviations:
                deviation, why = deviations[key]
                sure = f"; standard deviation {deviation:.2g} ({deviation / abs(values[name]):.0%}): {why}"
            lines[f"mmg.{name}"] = reasons[key] + sure
    return lines
