"""The criteria of the IMO's standards for ship manoeuvrability, resolution MSC.137(76), section 5.3, as functions of L and V.

L is the length between perpendiculars [m] (4.1.1), V the test speed [m/s]. They hold for ships of 100 m and more, and chemical
tankers and gas carriers of any length, in deep, unrestricted and calm water, at full load on even keel, at a test speed of at
least 90 % of that at 85 % of the engine's output (4.2.1). Distances are in lengths, angles in rad.
"""

import math

ADVANCE = 4.5  # 5.3.1, turning circle with 35 degrees or the most that the rudder does
TACTICAL_DIAMETER = 5.0
INITIAL_TURNING = 2.5  # 5.3.2, track until 10 degrees of heading with 10 degrees of rudder
TRACK_REACH = 15.0  # 5.3.4, full astern stopping test
MOST_TRACK_REACH = 20.0  # what an Administration may allow ships of large displacement
RUDDER = math.radians(35)
LEAST_LENGTH = 100.0  # m
LEAST_SPEED = 0.9  # of the speed in service, which stands for that at 85 % of the engine's output [assumed]


def first_overshoot(time: float) -> float:
    """Greatest first overshoot [rad] in the 10/10 zigzag (5.3.3.1), `time` = L / V [s]: 10 deg, 5 + L / 2V, 20 deg from 30 s on."""
    if time < 10:
        return math.radians(10)
    return math.radians(5 + 0.5 * time) if time < 30 else math.radians(20)


def second_overshoot(time: float) -> float:
    """Greatest second overshoot [rad] in the 10/10 zigzag (5.3.3.2): 25 deg, 17.5 + 0.75 L / V, 40 deg from 30 s on."""
    if time < 10:
        return math.radians(25)
    return math.radians(17.5 + 0.75 * time) if time < 30 else math.radians(40)


FIRST_OVERSHOOT_20 = math.radians(25)  # 5.3.3.3, in the 20/20 zigzag


def reservations(length: float, speed: float, service: float) -> list[str]:
    """Why the criteria are for information only, a sentence each; none for a ship and a speed that they are meant for."""
    why = []
    if length < LEAST_LENGTH:
        why.append(
            f"For information: MSC.137(76) is for ships of {LEAST_LENGTH:g} m and more"
            f" (chemical tankers and gas carriers of any length); this one has L = {length:g} m."
        )
    if speed < LEAST_SPEED * service:
        why.append(
            f"For information: the test speed is {speed / service:.0%} of that in service; MSC.137(76) asks for 90 % of the speed at"
            f" 85 % of the engine's output."
        )
    return why
