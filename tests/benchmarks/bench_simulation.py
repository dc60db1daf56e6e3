"""How fast ships are simulated: python tests/benchmarks/bench_simulation.py (one core, in steps of 0.1 s).

Prints ship-seconds per wall-second: one half-hour voyage of each ship under orders known beforehand, calm and in waves; batches of
50 voyages of cargo90 under a helm, in wind, and as a scenario with its sensors. With shipmmg installed, also a turning circle of
cargo90 by its adaptive solver held to the same step, and the ratio.
"""

import importlib.util
import sys
import time
from pathlib import Path

import numpy as np

from aspnn.guidance import held_orders, random_orders
from aspnn.simulation import Scenario, Sea, Ship, run_on, simulate, simulate_scenario
from aspnn.simulation.environment.waves import draw_waves
from aspnn.vessel import load_vessel

sys.path.insert(0, str(Path(__file__).parents[1]))
from peers import shipmmg

VOYAGES, DURATION, STEP = 50, 1800.0, 0.1
SHIPS = ("cargo90", "kvlcc2_full", "mariner", "trimaran", "otter", "workboat8")
SCENARIO = {
    "name": "bench",
    "vessel": "cargo90",
    "duration_s": DURATION,
    "voyages": VOYAGES,
    "start": {"speed_kn": 11.5, "latitude_deg": 69.65, "longitude_deg": 18.96, "zone": "33N", "heading_deg": "random"},
    "manoeuvre": {"kind": "random-orders"},
}


def rate(what, run, seconds, repeats=5):
    """Print and return ship-seconds per wall-second of `run`: the best of several, after one that compiles."""
    run()
    times = []
    for _ in range(repeats):
        begin = time.perf_counter()
        run()
        times.append(time.perf_counter() - begin)
    print(f"{what:45s} {seconds / min(times):12,.0f} ship-seconds per second")
    return seconds / min(times)


def singles(rng):
    """One voyage of each ship; that of cargo90 is returned."""
    found = {}
    for name in SHIPS:
        ship = Ship.of(load_vessel(name))
        most = float(np.degrees(ship.rudder.most))
        orders = random_orders(rng, DURATION, 0.8 * most, 0.8 * most / 7).at(np.arange(0, DURATION, STEP))[None]
        start = ship.start(0.0, 0.0, 0.0, 0.7 * ship.service_speed)
        sea = Sea(waves=draw_waves(rng, 0.01 * ship.vessel.length, 2 * ship.vessel.length**0.5, 0.5))
        found[name] = rate(f"{name}, one voyage", lambda s=ship, x=start, o=orders: run_on(s, x, o), DURATION, 20)
        rate(f"{name}, one voyage in waves", lambda s=ship, x=start, o=orders, w=sea: run_on(s, x, o, sea=w), DURATION)
    return found["cargo90"]


def peer(ours):
    """shipmmg on cargo90's turning circle in steps of at most 0.1 s."""
    if importlib.util.find_spec("shipmmg") is None:
        print("shipmmg is not installed, so there is no comparison with it")
        return
    mmg, speed, duration = Ship.of(load_vessel("cargo90")).model, 5.9, 300.0
    time_s = np.arange(0, duration + STEP / 2, STEP)
    turn = time_s, np.full(len(time_s), 0.6), mmg.balance(speed)[0], speed
    theirs = rate("shipmmg, in steps of at most 0.1 s", lambda: shipmmg(mmg, *turn, max_step=STEP), duration, 1)
    print(f"{'ratio to it of one voyage of cargo90':45s} {ours / theirs:12.0f}")


def main():
    rng = np.random.default_rng(1)
    ours = singles(rng)
    peer(ours)
    ship = Ship.of(load_vessel("cargo90"))
    orders = [random_orders(rng, DURATION, 35, 5) for _ in range(VOYAGES)]
    start = ship.start(np.zeros(VOYAGES), 0.0, rng.uniform(0, 2 * np.pi, VOYAGES), ship.service_speed)
    scenario, blow = Scenario.model_validate(SCENARIO), Sea(wind=np.array([10.0, 0.0]))
    all_of_them = VOYAGES * DURATION
    rate("50 of cargo90 under a helm", lambda: simulate(ship, held_orders(orders), start, DURATION), all_of_them, 1)
    rate("50 of cargo90 in a wind of 10 m/s", lambda: simulate(ship, orders, start, DURATION, sea=blow), all_of_them, 3)
    rate(
        "50 of cargo90 as a scenario with sensors",
        lambda: [len(log) for log, _ in simulate_scenario(scenario)],
        all_of_them,
        2,
    )


if __name__ == "__main__":
    main()
