"""aspnn, the open advanced ship predictor: where the hull will be, and how it will point, after a rudder order."""

from importlib import import_module

_PUBLIC = {
    "InputError": "schema",
    "KinematicPredictor": "prediction",
    "Log": "records",
    "Path": "motion",
    "Predictor": "prediction",
    "States": "records",
    "Vessel": "vessel",
    "Zone": "frames",
    "filter_log": "estimation",
    "load_vessel": "vessel",
    "pivot_point": "motion",
    "read_log": "records",
    "read_states": "records",
    "smooth_log": "estimation",
    "write_log": "records",
}
__all__ = sorted(_PUBLIC)
__version__ = "0.1.0"


def __getattr__(name: str):
    """Public names load their module on first use, so that `import aspnn` and the command line start at once."""
    if name not in _PUBLIC:
        raise AttributeError(f"module aspnn has no attribute {name}")
    return getattr(import_module(f"aspnn.{_PUBLIC[name]}"), name)


def __dir__() -> list[str]:
    return __all__
