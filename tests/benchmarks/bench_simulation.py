"""How fast the simulator is: python tests/benchmarks/bench_simulation.py (one core; at least 10,000 ship-seconds per second).

Prints ship-seconds per wall-second of a batch of 50 half-hour voyages of cargo90 at 0.1 s: integrated under a helm, integrated
under orders known beforehand, and the whole scenario with its sensors.
"""

import time

import numpy as np

from aspnn.guidance import held_orders, random_orders
from aspnn.simulation import (
    Scenario,
    Sea,
    Ship,
    run_on,
    simulate,
    simulate_scenario,
)
from aspnn.vessel import load_vessel

VOYAGES, DURATION, STEP = 50, 1800.0, 0.1
SCENARIO = {
    "name": "bench",
    "vessel": "cargo90",
    "duration_s": DURATION,
    "voyages": VOYAGES,
    "start": {"speed_kn": 11.5, "latitude_deg": 69.65, "longitude_deg": 18.96, "zone": "33N", "heading_deg": "random"},
    "manoeuvre": {"kind": "random-orders"},
}


def rate(what, run):
    """Print ship-seconds per wall-second of `run`: the best of three runs, after one that compiles."""
    run()
    times = []
    for _ in range(3):
        begin = time.perf_counter()
        run()
        times.append(time.perf_counter() - begin)
    print(f"{what}: {VOYAGES * DURATION / min(times):,.0f} ship-seconds per second")


def main():
    vessel = load_vessel("cargo90")
    ship, speed = Ship.of(vessel), vessel.service_speed
    rng = np.random.default_rng(1)
    orders = [random_orders(rng, DURATION, 35, 5) for _ in range(VOYAGES)]
    start = ship.start(np.zeros(VOYAGES), 0.0, rng.uniform(0, 2 * np.pi, VOYAGES), speed)
    series = np.array([one.at(np.arange(0, DURATION, STEP)) for one in orders])
    scenario = Scenario.model_validate(SCENARIO)
    blow = Sea(wind=np.array([10.0, 0.0]))
    rate("under a helm", lambda: simulate(ship, held_orders(orders), start, DURATION))
    rate("in a wind of 10 m/s", lambda: simulate(ship, orders, start, DURATION, sea=blow))
    rate("orders known", lambda: run_on(ship, start, series))
    rate("scenario with sensors", lambda: [len(log) for log, _ in simulate_scenario(scenario)])


if __name__ == "__main__":
    main()
