"""A ship in another loading seen as the ship of the training, in other units: a correction of nine numbers to any roll-out network.

Draught, trim and fouling change how strongly and how quickly a hull answers, less the way in which it does. So the network is asked
about a ship whose motion, rudder and clock are linear images of the true ones, and its answer is mapped back:

    u~ = U + (u e^-surge - U) e^slowing                       U the service speed: on a straight course, and what turning takes of it
    (v~, w~) = A (v, w), A = [[e^-sway, lean], [swing, e^-turn]]        v sway at midship, w half the difference of bow and stern
    d~ = e^rudder d + neutral                                 what the rudder does, and the angle at which it does nothing
    t~ = e^pace t                                             how quickly all of that comes

With all nine at zero it is the network itself. Equilibria and time constants move together, as another draught moves them; a
correction of the network's output alone would pull every turn back to that of the training. Depends on learning and numpy only.
"""

import numpy as np

from aspnn.learning.windows import WindowSpec
from aspnn.prediction.learned import Network
from aspnn.schema import InputError
from aspnn.vessel import Vessel

NAMES = ("sway", "turn", "surge", "rudder", "pace", "neutral", "slowing", "lean", "swing")
# How far a ship may be from that of the training, one standard deviation each: logarithms, `neutral` in rad (1 deg), the last two shares
# of the other speed. Assumed, wide enough for cargo90 between 4.3 and 6.5 m of draught (0.3, 0.3, 0.13, 0.05, 0.36, -, 0.09, -0.03, -0.18).
USUAL = np.array([0.3, 0.3, 0.15, 0.3, 0.3, np.radians(1.0), 0.3, 0.2, 0.2])
RUDDER = ("rudder_order", "rudder_angle")
KNOWN = {"surge", "sway_bow", "sway_stern", "yaw_rate", "shaft_speed", "wind_forward", "wind_starboard", *RUDDER}


def check_similar(spec: WindowSpec, name: str) -> None:
    """Refuse the checkpoint `name` if its network cannot be corrected so. Raises InputError that says why."""
    strange = [feature for feature in spec.inputs if feature not in KNOWN]
    if strange:
        raise InputError(f"{name}: sees {strange[0]}, which tracking cannot correct; track a checkpoint without it")
    lacks = [feature for feature in ("surge", "sway_bow", "sway_stern") if feature not in spec.inputs]
    if lacks or not set(RUDDER) & set(spec.forcings):
        raise InputError(
            f"{name}: does not see {lacks[0] if lacks else 'the rudder plan'}, which tracking corrects; track a roll-out network"
        )


def similar(network: Network, spec: WindowSpec, vessel: Vessel, parameters: np.ndarray) -> Network:
    """The network of a ship with `parameters` (9,) in the order of NAMES, or of n ships with (n, 9).

    Of n ships it is given n rows, or several times as many: the ships one after the other, then all of them again.
    """
    bow, stern = vessel.sway_stations

    def answer(history: np.ndarray, forcing: np.ndarray, wind: np.ndarray) -> np.ndarray:
        p = np.atleast_2d(parameters)
        p = np.tile(p, (len(history) // len(p), 1))
        surge, rudder, pace, slowing = np.exp(p[:, [2, 3, 4, 6]]).T[..., None]
        into = np.exp(-p[:, [0, 7, 8, 1]])
        into[:, 1:3] = p[:, 7:]
        into = into.reshape(-1, 2, 2)
        steps, ahead = history.shape[1], forcing.shape[1]
        past = between(history, steps - 1 - np.arange(steps)[::-1] / pace)
        sways = [spec.inputs.index(name) for name in ("sway_bow", "sway_stern")]
        past[..., sways] = stations(moved(midship(past[..., sways], bow, stern), into), bow, stern)
        if "yaw_rate" in spec.inputs:
            b, s = np.moveaxis(past[..., sways], -1, 0)
            past[..., spec.inputs.index("yaw_rate")] = (b - s) / (bow - stern)
        k = spec.inputs.index("surge")
        past[..., k] = vessel.service_speed + (past[..., k] / surge - vessel.service_speed) * slowing
        plan = between(forcing, np.arange(int(np.ceil((ahead - 1) * pace.max() - 1e-9)) + 1) / pace)
        for names, values in ((spec.inputs, past), (spec.forcings, plan)):
            for k, name in enumerate(names):
                if name in RUDDER:
                    values[..., k] = rudder * values[..., k] + p[:, 5:6]
        found = between(network(past, plan, wind), np.arange(ahead) * pace)
        found[..., 1:] = stations(moved(midship(found[..., 1:], bow, stern), np.linalg.inv(into)), bow, stern)
        found[..., 0] = (vessel.service_speed + (found[..., 0] - vessel.service_speed) / slowing) * surge
        return found

    return answer


def midship(sways: np.ndarray, bow: float, stern: float) -> np.ndarray:
    """Sway at midship and half the difference of bow and stern, of their sways (..., 2)."""
    b, s = np.moveaxis(sways, -1, 0)
    return np.stack([(bow * s - stern * b) / (bow - stern), (b - s) / 2], axis=-1)


def stations(motion: np.ndarray, bow: float, stern: float) -> np.ndarray:
    """The inverse of `midship`."""
    sway, half = np.moveaxis(motion, -1, 0)
    rate = 2 * half / (bow - stern)
    return np.stack([sway + bow * rate, sway + stern * rate], axis=-1)


def moved(motion: np.ndarray, by: np.ndarray) -> np.ndarray:
    """Motions (n, steps, 2) under the matrices (n, 2, 2) of their rows."""
    return motion @ np.swapaxes(by, -1, -2)


def between(values: np.ndarray, place: np.ndarray) -> np.ndarray:
    """`values` (n, steps, k) at fractional places (n, m) or (1, m) among the steps, linear; held beyond both ends. A new array."""
    last = values.shape[1] - 1
    place = np.clip(np.broadcast_to(place, (len(values), place.shape[-1])), 0, last)
    lower = np.minimum(place.astype(int), max(last - 1, 0))
    part, row = (place - lower)[..., None], np.arange(len(values))[:, None]
    return values[row, lower] * (1 - part) + values[row, np.minimum(lower + 1, last)] * part
