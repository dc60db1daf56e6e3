"""Windows: pieces of voyages that a network learns from, cut at rudder orders, shifted from them, and sliding.

Inputs come from filtered states, which know nothing of the future; labels from smoothed ones. A set of windows on disk
is one safetensors file that carries its WindowSpec.
"""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save_file

from aspnn.frames import to_body
from aspnn.learning import features
from aspnn.learning.servo import Servos
from aspnn.orders import Orders, Plan
from aspnn.records import States, atomic
from aspnn.schema import InputError

ORDER_SIZE = np.radians(5.0)  # a smaller change of the rudder order starts no window
ORDER_APART = 5.0  # s
WIND_MEMORY = 10.0  # s over which the wind at a start is averaged, where a spec does not say


@dataclass(frozen=True)
class WindowSpec:
    """What a window holds, in the units of `features`. It travels inside windows and checkpoints.

    `history` and `horizon` [s] at steps of `period` [s]; the history's last row is the start itself. Forcings are known
    for the future and given at every instant from the start to the horizon. The wind at the start is the mean of the last
    `wind_memory` [s]: what is gusty there, and what lasts. A current is sought in the last `current_memory` [s]; without it in as
    much as the horizon. `spatial`: whether states are those of the filter in three dimensions; `course_only`: of the course filter.
    """

    history: float
    horizon: float
    period: float
    inputs: tuple[str, ...]
    forcings: tuple[str, ...] = ()
    targets: tuple[str, ...] = features.TARGETS
    wind_memory: float = WIND_MEMORY
    current_memory: float | None = None
    spatial: bool = False
    course_only: bool = False

    def __post_init__(self):
        for kind, names, known in (
            ("input", self.inputs, tuple(features.FEATURES)),
            ("forcing", self.forcings, features.FORCINGS),
            ("target", self.targets, features.TARGETS),
        ):
            for name in names:
                if name not in known:
                    raise InputError(f"{kind} {name} is not known; choose among {', '.join(known)}")
        if not (0 < self.period <= min(self.history, self.horizon)):
            raise InputError(f"period {self.period:g} s must be positive and no longer than history and horizon")
        if not self.wind_memory > 0:
            raise InputError(f"wind_memory {self.wind_memory:g} s must be positive")
        if self.spatial and self.course_only:
            raise InputError("spatial and course_only are of two filters; set one of them")
        if self.current_memory is not None and not self.current_memory >= self.horizon:
            raise InputError(
                f"current_memory {self.current_memory:g} s must be no shorter than the horizon of {self.horizon:g} s"
            )

    @property
    def history_steps(self) -> int:
        """Rows of the history, the start included (300 for the thesis's 30 s at 0.1 s)."""
        return round(self.history / self.period)

    @property
    def horizon_steps(self) -> int:
        """Steps from the start to the horizon."""
        return round(self.horizon / self.period)

    @property
    def read(self) -> tuple[str, ...]:
        """Features that are read of the states: the inputs, and the shaft speed from which a plan's goes on."""
        return (*self.inputs, *({"shaft_speed"} & set(self.forcings) - set(self.inputs)))

    @property
    def time(self) -> np.ndarray:
        """Instants [s] from the start to the horizon, (horizon_steps + 1,)."""
        return np.arange(self.horizon_steps + 1) * self.period

    @staticmethod
    def from_dict(data: dict[str, Any]) -> "WindowSpec":
        """WindowSpec from plain data (JSON, TOML)."""
        values: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in data.items()}
        return WindowSpec(**values)


@dataclass(frozen=True)
class Sampling:
    """Where windows start: at rudder orders, at instants shifted from them [s], and every so many seconds."""

    at_orders: bool = True
    shifts: tuple[float, ...] = ()
    sliding: float | None = None


@dataclass(frozen=True)
class Windows:
    """A set of windows: float32 arrays with the window first.

    history (n, history_steps, inputs); forcing (n, horizon_steps + 1, forcings); target (n, horizon_steps + 1, 3):
    smoothed surge, bow and stern sway [m/s]; path (n, horizon_steps + 1, 3): smoothed position of midship forward and
    starboard of its place at the start [m] and heading change [rad]; wind (n, 2): velocity of the air north and east in
    axes turned to the start's heading [m/s], zero where not measured; start (n,) [s]; voyage (n,) index in `voyages`.
    """

    spec: WindowSpec
    history: np.ndarray
    forcing: np.ndarray
    target: np.ndarray
    path: np.ndarray
    wind: np.ndarray
    start: np.ndarray
    voyage: np.ndarray
    voyages: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.start)

    def select(self, which: np.ndarray) -> "Windows":
        """The windows at `which` (indices or mask), with the list of voyages kept."""
        return replace(self, **{name: getattr(self, name)[which] for name in ARRAYS})


ARRAYS = tuple(f.name for f in fields(Windows) if f.name not in ("spec", "voyages"))


def check_filter(states: States, spec: WindowSpec, name: str) -> None:
    """Refuse states of the course filter for the network `name` that learned from those of a filter with heading, and the reverse.

    Raises InputError.
    """
    without = "course_rad" in states.table
    if without != spec.course_only:
        made, learned = ("positions alone", "a heading") if without else ("a heading", "positions alone")
        again = "without" if without else "with"
        raise InputError(
            f"{states.path or 'states'}: made from {made}, but {name} learned from states with {learned}; filter the log again "
            f"{again} --course-only, or take another checkpoint or caa_ctra"
        )


def starts(states: States, spec: WindowSpec, sampling: Sampling) -> np.ndarray:
    """Rows of `states` where a window may start: enough history before, the whole horizon after, no coasting."""
    time = states["time_s"]
    orders = Orders.from_series(time, states["rudder_order_rad"])
    changes = orders.changes(ORDER_SIZE, ORDER_APART)
    instants = [changes] if sampling.at_orders else []
    instants += [changes + shift for shift in sampling.shifts]
    if sampling.sliding:
        instants.append(np.arange(time[0] + spec.history, time[-1] - spec.horizon, sampling.sliding))
    wanted = np.unique(np.concatenate(instants)) if instants else np.array([])
    inside = (wanted >= time[0] + spec.history) & (wanted <= time[-1] - spec.horizon + 1e-6)
    rows = np.unique(np.searchsorted(time, wanted[inside] - 1e-6))
    coasting = np.concatenate([[0], np.cumsum(states.table["coasting"].to_numpy(bool))])
    first = np.searchsorted(time, time[rows] - spec.history)
    last = np.searchsorted(time, time[rows] + spec.horizon)
    return rows[coasting[last] == coasting[first]]


def plan_of(states: States, row: int, horizon: float) -> Plan:
    """The plan that a voyage followed from `row` on: its recorded orders of rudder and engine, no measurement."""
    start, time = states["time_s"][row], states["time_s"]
    rudder, engine = (Orders.from_series(time, states[name]) for name in ("rudder_order_rad", "engine_order_rps"))
    ordered = engine.between(start, start + horizon) if np.isfinite(engine.values).all() else None
    return Plan(rudder.between(start, start + horizon), ordered)


def plans_sailed(states: States, starts: np.ndarray, span: float, forcings: Sequence[str]) -> list[Plan]:
    """The plans that a voyage followed from each of `starts` [s] over `span` [s], all of it past.

    Where engine orders are not known, the shaft speed that was measured stands for them. Where they are, it would go through the
    shaft's servo a second time.
    """
    time, shaft = states["time_s"], None
    rudder = Orders.from_series(time, states["rudder_order_rad"])
    if "shaft_speed" in forcings:
        ordered = states["engine_order_rps"]
        shaft = Orders.from_series(time, ordered if np.isfinite(ordered).any() else states["shaft_speed_rps"])
        shaft = shaft if np.isfinite(shaft.values).all() else None
    return [Plan(rudder.between(t, t + span), None if shaft is None else shaft.between(t, t + span)) for t in starts]


def make_windows(
    filtered: States, smoothed: States, spec: WindowSpec, rows: np.ndarray, servos: Servos | None = None
) -> Windows:
    """Windows of one voyage that start at `rows`. Inputs from `filtered`, labels from `smoothed` (same epochs).

    Without `servos` the rudder follows the plan at the rate of the vessel file.
    """
    servos = servos or Servos.of(filtered.vessel)
    filtered = servos.sailed(filtered)
    time, start = filtered["time_s"], filtered["time_s"][rows]
    instants = start[:, None] + spec.time

    def label(column):
        return np.interp(instants, time, smoothed[column])

    heading = label("heading_rad")
    north, east = label("north_m"), label("east_m")
    forward, starboard = to_body(north - north[:, :1], east - east[:, :1], heading[:, :1])
    plans = [plan_of(filtered, row, spec.horizon) for row in rows]
    known = [
        features.forcing(servos, begin, plan, spec.forcings, spec.time)
        for begin, plan in zip(features.begins(servos, filtered, rows), plans, strict=True)
    ]
    return Windows(
        spec=spec,
        history=features.history(filtered, rows, spec.inputs, spec.history_steps, spec.period).astype(np.float32),
        forcing=np.stack(known).astype(np.float32),
        target=np.stack([label(f"{name}_m_s") for name in spec.targets], -1).astype(np.float32),
        path=np.stack([forward, starboard, heading - heading[:, :1]], -1).astype(np.float32),
        wind=start_wind(filtered, rows, spec.wind_memory).astype(np.float32),
        start=start,
        voyage=np.zeros(len(rows), np.int64),
        voyages=(filtered.voyage,),
    )


def start_wind(states: States, rows: np.ndarray, memory: float = WIND_MEMORY) -> np.ndarray:
    """Velocity of the air (n, 2) forward and to starboard at the start [m/s], the mean of the last `memory` [s].

    Zero where wind is not measured: the predictor then knows of none.
    """
    speed = states["wind_speed_true_m_s"]
    if np.isnan(speed).all():
        return np.zeros((len(rows), 2))
    # The vector mean is taken in earth axes, then turned to the heading at the start; air moves away from where it comes.
    earth = np.nan_to_num(-speed * np.exp(1j * states["wind_from_grid_rad"]))
    total, time = np.concatenate([[0], np.cumsum(earth)]), states["time_s"]
    first = np.searchsorted(time, time[rows] - memory)
    mean = (total[rows + 1] - total[first]) / (rows + 1 - first) * np.exp(-1j * states["heading_rad"][rows])
    return np.stack([mean.real, mean.imag], -1)


def concatenate(parts: Sequence[Windows]) -> Windows:
    """One set of windows from those of several voyages; parts of one voyage keep one voyage index."""
    if not parts:
        raise InputError("no voyage gave a window")
    names = list(dict.fromkeys(name for part in parts for name in part.voyages))
    arrays = {name: np.concatenate([getattr(p, name) for p in parts]) for name in ARRAYS if name != "voyage"}
    voyage = np.concatenate([np.array([names.index(p.voyages[v]) for v in p.voyage], np.int64) for p in parts])
    return Windows(parts[0].spec, voyage=voyage, voyages=tuple(names), **arrays)


def write_windows(windows: Windows, path: str | Path) -> None:
    """Write windows as safetensors with the spec and the voyages in its metadata, atomically."""
    arrays = {name: np.ascontiguousarray(getattr(windows, name)) for name in ARRAYS}
    metadata = {"spec": json.dumps(asdict(windows.spec)), "voyages": json.dumps(windows.voyages), "format": "1"}
    with atomic(path) as temporary:
        save_file(arrays, temporary, metadata)


def read_windows(path: str | Path) -> Windows:
    """Read windows written by `write_windows`. Raises InputError naming the file."""
    try:
        with safe_open(path, "numpy") as file:
            metadata = file.metadata() or {}
            arrays = {name: file.get_tensor(name) for name in ARRAYS}
        spec = WindowSpec.from_dict(json.loads(metadata["spec"]))
        return Windows(spec, voyages=tuple(json.loads(metadata["voyages"])), **arrays)
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except (SafetensorError, KeyError, OSError, ValueError) as error:
        raise InputError(f"{path}: is no windowed dataset ({str(error).splitlines()[0]}); make it again") from None
