"""The ships about a simulated bridge: those that a scenario names, or four made-up ones. They keep their speed and their turn."""

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from aspnn.frames import Zone, convergence, to_grid
from aspnn.logs.ais_write import INTERVALS
from aspnn.logs.readings import KNOT
from aspnn.motion.path import rigid_step
from aspnn.simulation.scenario import OtherShip
from aspnn.vessel import Vessel, from_dict

# MMSI, name, ahead and to starboard of the start [m], heading relative to hers [deg], speed as a share of hers, turn [deg/min],
# length [m] (metres for a ship of 90 m, to scale for others), seconds between reports.
SHIPS = (
    (257000011, "NORDLYS", 1500.0, 900.0, -90.0, 0.75, 0.0, 110.0, 6.0),
    (257000012, "HAVBRIS", 2600.0, -120.0, 180.0, 0.9, 0.0, 70.0, 6.0),
    (257000013, "TINDEN", 700.0, -700.0, 20.0, 0.6, 12.0, 40.0, 3.0),
    (257000014, "SKARVEN", 900.0, 400.0, 130.0, 0.0, 0.0, 30.0, 10.0),
)


@dataclass
class Traffic:
    """Another ship: on a circle or a straight line at a steady speed, with a `leg` [m] to and fro. `place` north + i east [m], angles of
    the grid [rad]."""

    mmsi: int
    name: str
    vessel: Vessel
    place: complex
    heading: float
    speed: float
    rate: float
    every: float  # s between reports
    leg: float = math.inf
    gone: float = 0.0  # m of the leg
    due: float = 0.0
    static_due: float = 0.0

    def move(self, dt: float) -> None:
        """Run on for `dt` [s], exactly."""
        north, east, turn = rigid_step(self.heading, self.speed, 0.0, self.rate, dt)
        self.place, self.heading = self.place + complex(north, east), self.heading + turn
        self.gone += self.speed * dt
        if self.gone >= self.leg:  # a double-ended ferry: the other end is the bow now
            self.gone, self.heading = 0.0, self.heading + math.pi


def named(ships: Iterable[OtherShip], zone: Zone) -> list[Traffic]:
    """The ships that a scenario names. They report as often as class A at their speed does."""
    made = []
    for ship in ships:
        latitude, longitude = math.radians(ship.latitude_deg), math.radians(ship.longitude_deg)
        place = complex(*(float(x) for x in to_grid(latitude, longitude, zone)))
        heading = math.radians(ship.heading_deg) - float(convergence(latitude, longitude, zone))
        rate, leg = math.radians(ship.turn_deg_min) / 60, ship.leg_m or math.inf
        every = next(turning if rate else steady for limit, steady, turning in INTERVALS if ship.speed_kn <= limit)
        vessel = _sized(ship.mmsi, ship.length_m)
        made.append(Traffic(ship.mmsi, ship.name, vessel, place, heading, ship.speed_kn * KNOT, rate, every, leg))
    return made


def made_up(place: complex, heading: float, length: float, speed: float) -> list[Traffic]:
    """Four ships about a ship of `length` [m] at a `place`: one crosses from starboard, one meets her, one turns, one is at anchor."""
    scale, pace, made = max(length, 60.0) / 90.0, max(speed, 2.0), []
    for mmsi, name, ahead, right, relative, share, rate, size, every in SHIPS:
        there = place + complex(ahead, right) * scale * np.exp(1j * heading)
        bearing, turn = heading + math.radians(relative), math.radians(rate) / 60
        made.append(Traffic(mmsi, name, _sized(mmsi, size * scale), there, bearing, share * pace, turn, every))
    return made


def _sized(mmsi: int, length: float) -> Vessel:
    """A vessel of which only the size matters."""
    return from_dict(
        {
            "name": f"target-{mmsi}",
            "dimensions": {"length_overall_m": length, "beam_m": length / 6.5, "draught_m": length / 19.5},
            "rudder": {"max_deg": 35, "rate_deg_s": 2.5},
            "service": {"speed_m_s": 6.0},
        }
    )
