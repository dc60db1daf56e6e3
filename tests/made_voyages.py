"""Voyages made of sines, all of whose derivatives are exact: what sensors must record of them can be worked out by hand."""

import numpy as np

from aspnn.simulation import Voyage


def sines(t, *terms):
    """Value, rate and acceleration of a sum of terms (amplitude, circular frequency, phase); frequency 0: slope and value."""
    value, rate, acceleration = np.zeros((3, len(t)))
    for a, w, p in terms:
        if w == 0:
            value, rate = value + a * t + p, rate + a
        else:
            value, rate = value + a * np.sin(w * t + p), rate + a * w * np.cos(w * t + p)
            acceleration = acceleration - a * w**2 * np.sin(w * t + p)
    return value, rate, acceleration


def made(
    place, duration=600.0, dt=0.1, speed=(5.0, 1.0), turn=((0.3, 0.02, 0.0),), roll=(), pitch=(), heave=(), **others
) -> Voyage:
    """A ship whose midship runs from `place` at `speed` (north, east) with a swerve, heading by the sines `turn`."""
    t = np.arange(round(duration / dt) + 1) * dt
    n, n1, n2 = sines(t, (speed[0], 0, place[0]), (3.0, 0.05, 0.4))
    e, e1, e2 = sines(t, (speed[1], 0, place[1]), (2.0, 0.07, 1.0))
    psi, r, r1 = sines(t, *turn)
    c, s = np.cos(psi), np.sin(psi)
    u, v = n1 * c + e1 * s, e1 * c - n1 * s
    ahead, athwart = n2 * c + e2 * s, e2 * c - n2 * s
    rudder = sines(t, (np.radians(20), 0.05, 0.0))[0]
    base = Voyage.level(t, n, e, psi, u, v, r, ahead + r * v, athwart - r * u, r1, rudder, np.full(len(t), 2.0))
    (phi, p, _), (theta, q, _), (down, down1, down2) = (sines(t, *terms) for terms in (roll, pitch, heave))
    tilt = {"roll": phi, "roll_rate": p, "pitch": theta, "pitch_rate": q}
    tilt |= {"heave": down, "heave_rate": down1, "heave_acceleration": down2}
    return base.__class__(**{**vars(base), **tilt, **others})
