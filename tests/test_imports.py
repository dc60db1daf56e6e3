"""What starting costs: nothing heavy is imported before it is used."""

import subprocess
import sys

import pytest

import aspnn

HEAVY = {"torch", "lightning", "matplotlib", "plotly", "pandas", "numba", "scipy", "sklearn", "pyproj", "pyarrow"}


def modules_after(code: str) -> set[str]:
    """Top-level modules that a fresh interpreter holds after `code`."""
    code += "\nimport sys; print(*{name.partition('.')[0] for name in sys.modules})"
    return set(subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout.split())


def test_import_is_light():
    """sys.modules of a fresh interpreter: `import aspnn` reads no array, table, network or plotting library."""
    assert not modules_after("import aspnn") & (HEAVY | {"numpy"})


def test_reading_a_log_needs_no_network_and_no_plots():
    """sys.modules of a fresh interpreter: the records bring pandas (the probe works), but no torch and no plotting."""
    modules = modules_after("import aspnn; aspnn.read_log, aspnn.load_vessel, aspnn.pivot_point")
    assert "pandas" in modules
    assert not modules & {"torch", "lightning", "matplotlib", "plotly", "sklearn"}


@pytest.mark.parametrize("name", aspnn.__all__)
def test_public_name_is_there(name):
    """Each public name is what its own module calls by that name."""
    assert getattr(aspnn, name).__name__ == name


def test_unknown_name_is_an_attribute_error():
    """Python's own rule for modules, which hasattr and autocompletion rely on."""
    assert not hasattr(aspnn, "predict_ship")
    assert dir(aspnn) == aspnn.__all__
