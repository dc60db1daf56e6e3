"""Long campaigns of random orders for every ship: does anything blow up, capsize or run backwards (issue "The bridge simulator")?

Rudder orders are uniform in the stops, held 2 to 20 ship lengths; shaft orders 40 to 100 % of the service speed's. Prints, by
vessel, ship-hours, greatest speed, sway, yaw rate and attitude, the share of time out of the model's domain, and the speed of
simulation (one core, actuators and all). Exit code 1 where a state is not finite or a ship ran astern with its engine ahead.

Usage: python training/reproduce/campaign.py [--hours 100] [--waves]
"""

import argparse
import math
import sys
import time as clock

import numpy as np

from aspnn.guidance import helms, random_orders
from aspnn.simulation import Sea, Ship, run_on
from aspnn.simulation.environment.waves import draw_waves
from aspnn.vessel import load_vessel

SHIPS = ("cargo90", "kvlcc2_l7", "kvlcc2_full", "mariner", "otter", "trimaran", "workboat8")
VOYAGE = 3600.0  # s


def campaign(name: str, hours: int, rough: bool) -> bool:
    """Run and print one ship's campaign; whether it held."""
    ship = Ship.of(load_vessel(name))
    length, speed = ship.vessel.length, ship.service_speed
    dt, unit = min(0.1, ship.largest_step() / (2 if rough else 1)), length / speed
    time, rng = np.arange(0, VOYAGE, dt), np.random.default_rng(100)
    most, start = math.degrees(ship.rudder.most), ship.start(0.0, 0.0, 0.0, speed)
    least, worst, outside, spent, finite = math.inf, np.zeros(ship.columns), 0.0, 0.0, True
    for _ in range(hours):
        orders = random_orders(rng, VOYAGE, most, most / 7, (2 * unit, 20 * unit)).at(time)
        levels = np.repeat(rng.uniform(0.4, 1.0, 12), math.ceil(len(time) / 12))[: len(time)]
        sea = Sea()
        if rough:  # as steep for every size: a significant height of a hundredth of the length of the wave at the peak
            period = 2 * math.sqrt(length)
            sea = Sea(
                waves=draw_waves(rng, 9.81 * period**2 / (2 * math.pi) / 100, period, rng.uniform(0, 2 * math.pi))
            )
        begin = clock.perf_counter()
        x = run_on(ship, start, orders[None], shaft=levels[None] * start[0, helms.SHAFT], sea=sea, dt=dt)[0]
        spent += clock.perf_counter() - begin
        finite &= bool(np.isfinite(x[:, : helms.PITCH_RATIO]).all() and np.isfinite(x[:, helms.COLUMNS :]).all())
        least, worst = min(least, x[:, helms.SURGE].min()), np.maximum(worst, np.abs(x).max(axis=0))
        outside += float(np.count_nonzero(ship.outside(x))) / len(x) / hours
    tilt = (
        f", roll {math.degrees(worst[helms.ROLL]):.0f} deg, pitch {math.degrees(worst[helms.PITCH]):.0f} deg"
        if ship.columns == helms.SIX
        else ""
    )
    holds = finite and least > (-0.2 if rough else -0.02) * speed
    print(
        f"{name:12s} {hours} h, step {dt:.3g} s: surge {least:.2f} to {worst[helms.SURGE]:.2f} m/s, sway to {worst[helms.SWAY]:.2f} m/s,"
        f" yaw rate to {math.degrees(worst[helms.YAW_RATE]):.2f} deg/s{tilt}; out of domain {100 * outside:.1f} %;"
        f" {hours * VOYAGE / spent:,.0f} ship-s/s {'' if holds else 'DOES NOT HOLD'}"
    )
    return holds


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hours", type=int, default=100)
    parser.add_argument("--waves", action="store_true", help="in waves as steep for every size of ship")
    args = parser.parse_args()
    held = [campaign(name, args.hours, args.waves) for name in SHIPS]
    sys.exit(0 if all(held) else 1)


if __name__ == "__main__":
    main()
