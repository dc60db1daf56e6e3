"""Maximum likelihood finds the noise that the data were made with; noise files carry it to the filters."""

import json
from dataclasses import asdict, replace

import numpy as np
import pandas as pd
import pytest

from aspnn import cli, records, workflow
from aspnn.estimation.noise_file import with_noise_file, write_noise_file
from aspnn.estimation.tuning import Tuning, tune
from aspnn.instruments import Calibration, Noise
from aspnn.records import Log
from aspnn.schema import InputError
from aspnn.vessel import load_vessel

TRUE = Noise(position=0.3, heading=0.004, yaw_rate=0.0005, acceleration=0.02, jerk_density=4e-6, yaw_jerk_density=3e-9)


def made_log(seed: int, n: int = 6000, dt: float = 0.1) -> Log:
    """A log of motion driven by white jerk of the densities of TRUE, by fine Euler steps, noise of TRUE added."""
    rng, fine = np.random.default_rng(seed), 10
    h, steps = dt / fine, n * fine

    def driven(density, start):
        """Acceleration, rate and place of a white-jerk chain at the epochs, (3, steps)."""
        a = np.cumsum(np.sqrt(density * h) * rng.standard_normal(steps))
        rate = start + np.concatenate([[0], np.cumsum((a[1:] + a[:-1]) / 2 * h)])
        return a, rate

    _, r = driven(TRUE.yaw_jerk_density, 0.0)
    psi = np.concatenate([[0], np.cumsum((r[1:] + r[:-1]) / 2 * h)])
    (a_u, u), (a_v, v) = driven(TRUE.jerk_density, 5.0), driven(TRUE.jerk_density, 0.0)
    velocity = np.exp(1j * psi) * (u + 1j * v)
    place = np.concatenate([[0], np.cumsum((velocity[1:] + velocity[:-1]) / 2 * h)])
    rows = slice(0, None, fine)
    noise = {name: rng.standard_normal((4, n)) for name in ("a", "b")}
    table = {
        "time_s": np.arange(n) * dt,
        "midship_north_m": place.real[rows] + TRUE.position * noise["a"][0],
        "midship_east_m": place.imag[rows] + TRUE.position * noise["a"][1],
        "heading_deg": np.degrees(psi[rows] + TRUE.heading * noise["a"][2]) % 360,
        "yaw_rate_deg_s": np.degrees(r[rows] + TRUE.yaw_rate * noise["a"][3]),
        "acceleration_surge_m_s2": (a_u - v * r)[rows] + TRUE.acceleration * noise["b"][0],
        "acceleration_sway_m_s2": (a_v + u * r)[rows] + TRUE.acceleration * noise["b"][1],
    }
    return Log(pd.DataFrame(table), load_vessel("cargo90"))


def test_likelihood_finds_the_noise():
    """Oracle: the noise the log was made with. Sensors within 3 % (6000 samples: sd 0.9 %), densities within a half.

    Statistic: the standard errors are those of 6000 samples, sd / sqrt(2 n) per row, and tell the errors within 4 of them.
    """
    vessel = replace(load_vessel("cargo90"), noise=Noise())
    tuning = tune([made_log(1)], vessel, sensors=True)
    found = tuning.vessel.noise
    for name in ("position", "heading", "yaw_rate", "acceleration"):
        assert getattr(found, name) == pytest.approx(getattr(TRUE, name), rel=0.03), name
        assert abs(getattr(found, name) - getattr(TRUE, name)) < 4 * tuning.errors[name], name
    for name, rows in (("heading", 1), ("position", 2), ("acceleration", 2)):
        assert tuning.errors[name] == pytest.approx(getattr(TRUE, name) / np.sqrt(2 * 6000 * rows), rel=0.1), name
    for name in ("jerk_density", "yaw_jerk_density"):
        assert getattr(found, name) == pytest.approx(getattr(TRUE, name), rel=0.5)
        assert abs(getattr(found, name) - getattr(TRUE, name)) < 4 * tuning.errors[name], name
    assert tuning.after > tuning.before and tuning.start == vessel
    assert tuning.vessel.calibration == Calibration()  # not sought


def test_no_log_is_said():
    """Contract: one line."""
    with pytest.raises(InputError, match="no log"):
        tune([], load_vessel("cargo90"))


@pytest.fixture(scope="module")
def tuned():
    """What tuning might have found: every field another than before."""
    vessel = load_vessel("cargo90")
    after = replace(vessel, noise=TRUE, calibration=Calibration(0.02, 0.2, 0.0, 0.5, 0.1))
    errors = {"position": 0.01, "heading_offset": np.radians(0.1), "jerk_density": 1e-7}
    return Tuning(vessel, after, errors, {"heading_delay": "the clock"}, 10.0, 11.0)


def test_noise_file_is_read_back_unchanged(tuned, tmp_path):
    """Round trip, bit for bit; provenance names logs with their SHA-256 and standard errors in the units of the keys."""
    records.write_log(made_log(2, n=50), tmp_path / "one.parquet")
    path = tmp_path / "noise.json"
    write_noise_file(tuned, [tmp_path / "one.parquet"], path)
    assert with_noise_file(tuned.start, path) == tuned.vessel
    said = json.loads(path.read_text())["provenance"]
    assert said["logs"] == [{"name": "one.parquet", "sha256": records.sha256(tmp_path / "one.parquet")}]
    assert said["standard_errors"]["calibration.heading_offset_deg"] == pytest.approx(0.1)
    assert said["log_likelihood_per_epoch"] == {"before": 10.0, "after": 11.0}


@pytest.mark.parametrize(
    "change, words",
    [
        ({"vessel": "tug"}, "is for vessel tug, not for cargo90"),
        ({"sensor": {}}, "key sensor is not known, did you mean sensors"),
        ({"sensors": {"position": 1.0}}, "sensors.position is not a known noise"),
        ({"process": {"jerk_density_m2_s5": -1.0}}, "process.jerk_density_m2_s5 = -1.0 must be a positive"),
        ({"calibration": {"position_delay_s": 9.0}}, "calibration.position_delay_s = 9.0 must be"),
        ({"calibration": 0.2}, "calibration must be an object"),
    ],
)
def test_wrong_noise_file_is_one_line(tuned, tmp_path, change, words):
    """Contract: InputError that names the file and the key."""
    path = tmp_path / "noise.json"
    write_noise_file(tuned, [], path)
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    with pytest.raises(InputError, match=f"noise.json: .*{words}") as error:
        with_noise_file(tuned.start, path)
    assert "\n" not in str(error.value)


def test_noise_file_that_cannot_be_read_is_one_line(tuned, tmp_path):
    """Contract: absent, not JSON, not an object."""
    (tmp_path / "torn.json").write_text("{")
    (tmp_path / "list.json").write_text("[]")
    for name, words in (("absent", "cannot be read"), ("torn", "not JSON"), ("list", "a noise file holds one")):
        with pytest.raises(InputError, match=f"{name}.json: {words}"):
            with_noise_file(tuned.start, tmp_path / f"{name}.json")


def run(monkeypatch, *words) -> int:
    """Exit code of the command in this process."""
    monkeypatch.setattr("sys.argv", ["aspnn", *map(str, words)])
    with pytest.raises(SystemExit) as end:
        cli.main()
    return end.value.code


def test_the_command_tunes_and_the_filter_uses_it(tmp_path, monkeypatch, capsys):
    """Contract: a table, a noise file, states of the tuned vessel; the noise found is that of `tune` on the same log."""
    log, out = tmp_path / "one.parquet", tmp_path / "noise.json"
    made, noise = made_log(3, n=1500), replace(TRUE, jerk_density=1.7e-6, yaw_jerk_density=1e-8)
    records.write_log(replace(made, vessel=replace(made.vessel, noise=noise)), log)
    assert run(monkeypatch, "tune", log, "--out", out) == 0
    said = capsys.readouterr().out
    assert "process.jerk_density_m2_s5" in said and "log-likelihood per epoch" in said and "not sought" in said
    expected = tune([records.read_log(log)], records.read_log(log).vessel).vessel
    assert expected.noise.position == TRUE.position and expected.noise.jerk_density != 1.7e-6
    assert with_noise_file(load_vessel("cargo90"), out).noise == expected.noise
    assert run(monkeypatch, "filter", log, "--out", tmp_path / "states", "--noise", out, "--quiet") == 0
    states = records.read_states(tmp_path / "states" / "one.states.parquet")
    assert asdict(states.vessel.noise) == asdict(expected.noise)
    plain = workflow.filter_files([log], tmp_path / "plain")
    assert not np.allclose(records.read_states(plain[0])["sway_m_s"], states["sway_m_s"])


def test_logs_of_two_vessels_are_refused(tmp_path, monkeypatch, capsys):
    """Contract: exit code 2, one line that names both, no file."""
    log = made_log(4, n=50)
    records.write_log(log, tmp_path / "one.parquet")
    records.write_log(replace(log, vessel=replace(log.vessel, name="tug")), tmp_path / "two.parquet")
    assert run(monkeypatch, "tune", tmp_path, "--out", tmp_path / "noise.json") == 2
    said = capsys.readouterr().err
    assert "tug" in said and "cargo90" in said and said.count("\n") == 1
    assert not (tmp_path / "noise.json").exists()
