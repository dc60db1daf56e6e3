"""Campaigns: the same files whatever the workers and however often a run was stopped, and one clear line for what goes wrong."""

import contextlib
import errno
import json
import multiprocessing
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from aspnn import records
from aspnn.schema import InputError
from aspnn.simulation import campaign, read_scenario
from aspnn.simulation.campaign import run_campaign
from tests.test_imports import modules_after

TRIP = """
vessel = "cargo90"
voyages = {voyages}
duration_s = {duration}
seed = 7
[start]
speed_kn = [6, 12]
latitude_deg = 69.65
longitude_deg = 18.96
zone = "33N"
heading_deg = "random"
[manoeuvre]
kind = "random-orders"
hold_s = [5, 15]
[environment]
current_kn = [0, 2]
current_towards_deg = "random"
wind_kn = [0, 20]
wind_from_deg = "random"
"""
posix = pytest.mark.skipif(sys.platform == "win32", reason="signals and resource limits of POSIX")


def bare(things, what, count):
    """The watch that shows nothing."""
    return things


@pytest.fixture
def trip(tmp_path):
    """Writes a scenario file and returns its path."""

    def write(voyages=5, duration=30, text=TRIP):
        path = tmp_path / "trip.toml"
        path.write_text(text.format(voyages=voyages, duration=duration))
        return path

    return write


@pytest.fixture
def go(tmp_path):
    """Runs the campaign of a scenario file into a folder of that name; returns its files and their bytes."""

    def run(path, out, voyages=None, seed=None, workers=1, scheduler=None, watch=bare):
        run_campaign(read_scenario(path), tmp_path / out, voyages, seed, workers, scheduler, watch)
        return contents(tmp_path / out)

    return run


def contents(folder: Path) -> dict[str, bytes]:
    """All files of a folder, hidden ones too."""
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def heard() -> None:
    """Let the interrupt be heard where a shell that runs the tests in its background has it ignored."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def command(scenario, out, *words, first=heard) -> subprocess.Popen:
    """`aspnn simulate` in a process group of its own, which does `first` before it begins."""
    line = [sys.executable, "-m", "aspnn.cli", "simulate", scenario, "--out", out, *words]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    return subprocess.Popen([str(word) for word in line], start_new_session=True, preexec_fn=first, **pipes)


def logs(folder: Path) -> set[str]:
    """Names of the voyages whose logs are there."""
    return {path.stem for path in folder.glob("[!.]*.parquet") if ".truth" not in path.name}


def wait_for(happened, seconds=60):
    """Wait until `happened()`; fails when it does not."""
    until = time.monotonic() + seconds
    while not happened():
        assert time.monotonic() < until, "it did not happen"
        time.sleep(0.005)


def test_files_are_the_same_whatever_the_workers(trip, go, tmp_path, monkeypatch):
    """Oracle: byte by byte. One batch in this process; two processes; a batch per voyage; a part of a larger campaign."""
    one = go(trip(), "one")
    assert go(trip(), "two", workers=2) == one
    monkeypatch.setattr(campaign, "batch_size", lambda scenario: 1)
    assert go(trip(), "single") == one
    larger = go(trip(), "larger", voyages=7)
    assert {name: larger[name] for name in one if name.endswith(".parquet")} == {
        name: data for name, data in one.items() if name.endswith(".parquet")
    }
    assert not multiprocessing.active_children()


def test_manifest_holds_what_made_the_voyages(trip, go, tmp_path):
    """Oracle: the files themselves, and `campaign` from the manifest's own contents."""
    made = go(trip(), "out")
    manifest = json.loads(made.pop("trip.manifest.json"))
    listed = [entry[key] for entry in manifest["voyages"] for key in ("file", "truth")]
    assert sorted(listed) == sorted(made)
    for entry in manifest["voyages"]:
        log = records.read_log(tmp_path / "out" / entry["file"])
        assert entry["rows"] == len(log) == len(records.read_truth(log)) == 301
        assert log.notes["campaign"] == manifest["campaign"]
        assert log.vessel.to_dict() == manifest["vessel"]["parameters"]
        assert entry["sha256"] == records.sha256(tmp_path / "out" / entry["file"])
        assert entry["truth_sha256"] == records.sha256(tmp_path / "out" / entry["truth"])
    makers = {key: manifest[key] for key in ("version", "code_sha256", "scenario", "seed", "vessel")}
    assert manifest["campaign"] == campaign._sha256(makers)
    assert manifest["vessel"]["sha256"] == campaign._sha256(manifest["vessel"]["parameters"])
    assert (manifest["seed"], manifest["scenario"]["duration_s"]) == (7, 30)


@posix
def test_killed_run_goes_on(trip, go, tmp_path):
    """Oracle: the folder of a run that nobody killed (-9), byte by byte. Complete voyages are not made again; no process stays."""
    path, out = trip(voyages=40, duration=120), tmp_path / "killed"
    run = command(path, out, "--workers", 2)
    wait_for(lambda: len(logs(out)) >= 3)
    run.kill()
    run.wait()
    run.stdout.read()  # ends when no worker holds it any more
    ready = {name: (out / f"{name}.parquet").stat().st_mtime_ns for name in logs(out)}
    assert 3 <= len(ready) < 40
    (out / ".trip-0039.truth.parquet.abcd_123.parquet").write_bytes(b"half")
    resumed = go(path, "killed")
    assert {name: (out / f"{name}.parquet").stat().st_mtime_ns for name in ready} == ready
    assert resumed == go(path, "whole")


@posix
def test_interrupted_run_says_how_to_go_on(trip, go, tmp_path):
    """Contract: Ctrl-C in the terminal, which reaches the workers too, gives one line and exit code 130, and no half file."""
    path, out = trip(voyages=60, duration=240), tmp_path / "out"
    run = command(path, out, "--workers", 2)
    wait_for(lambda: len(logs(out)) >= 1)
    os.killpg(run.pid, signal.SIGINT)
    said = run.communicate(timeout=60)[1]
    assert said == f"stopped: {len(logs(out))} of 60 voyages are complete in {out}; the same command makes the others\n"
    assert run.returncode == 130
    assert not [name for name in contents(out) if name.startswith(".")]


def test_lost_worker_is_said(trip, go, monkeypatch):
    """Contract: a worker killed as by the kernel for want of memory gives one line, no hang, and a folder to go on with."""
    monkeypatch.setattr(campaign, "batch_size", lambda scenario: 1)

    def killing(things, what, count):
        for thing in things:
            if what == "simulating":
                for child in multiprocessing.active_children():
                    child.kill()
            yield thing

    with pytest.raises(
        InputError, match=r"out: a worker was ended from outside.*of 20 voyages are complete in.*out"
    ) as error:
        go(trip(voyages=20), "out", workers=2, watch=killing)
    assert "\n" not in str(error.value)
    assert go(trip(voyages=20), "out") == go(trip(voyages=20), "whole")


@posix
def test_workers_that_cannot_write_stop_cleanly(trip, go, tmp_path):
    """Contract: the system refuses to let files grow (in place of a full disk): one line, exit code 2, nothing half-written."""
    import resource

    path, out = trip(duration=200), tmp_path / "out"
    size = 60_000  # bytes: room for the manifest, none for a truth of 2001 rows
    run = command(path, out, "--workers", 2, first=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (size, size)))
    said = run.communicate(timeout=100)[1]
    assert (run.returncode, said.count("\n")) == (2, 1), said
    assert said.startswith("error: ") and os.strerror(errno.EFBIG) in said and "0 of 5 voyages are complete" in said
    assert set(contents(out)) == {"trip.manifest.json"}
    assert go(path, "out") == go(path, "whole")


def test_full_disk_stops_cleanly(trip, go, tmp_path, monkeypatch):
    """Contract: the disk is full in the middle of the third log. One line; voyages 0 and 1 stay, no half file; it goes on."""
    write = pq.write_table

    def full(table, path, **settings):
        write(table, path, **settings)
        if ".trip-0002.parquet" in str(path):
            os.truncate(path, 1000)
            raise OSError(errno.ENOSPC, "Error writing bytes to file")

    with monkeypatch.context() as patch:
        patch.setattr(pq, "write_table", full)
        with pytest.raises(InputError, match=f"{os.strerror(errno.ENOSPC)}; 2 of 5 voyages are complete"):
            go(trip(), "out")
    assert logs(tmp_path / "out") == {"trip-0000", "trip-0001"}
    assert not list((tmp_path / "out").glob(".*"))
    assert go(trip(), "out") == go(trip(), "whole")


@pytest.mark.parametrize(
    "change, said",
    [
        (("duration_s = 30", "duration_s = 31"), r"scenario.duration_s is 30.0 there, 31.0 here"),
        (("seed = 7", "seed = 8"), r"scenario.seed is 7 there, 8 here"),
        (("wind_kn = [0, 20]", ""), r"scenario.environment.wind_kn is \[0.0, 20.0\] there, \[0.0, 0.0\] here"),
    ],
)
def test_another_scenario_of_that_name_is_refused(trip, go, tmp_path, change, said):
    """Contract: one line that says what differs, and nothing is touched."""
    path = trip()
    before = go(path, "out")
    path.write_text(path.read_text().replace(*change))
    with pytest.raises(InputError, match=rf"trip.manifest.json: is of another campaign \({said}\); give another --out"):
        go(path, "out")
    assert contents(tmp_path / "out") == before


def test_another_version_or_vessel_is_refused(trip, go, tmp_path, monkeypatch):
    """Contract: voyages of two programs, or of two ships, are never mixed."""
    go(trip(), "out")
    with monkeypatch.context() as patch:
        patch.setattr(campaign, "__version__", "99")
        with pytest.raises(InputError, match=r'version is ".*" there, "99" here'):
            go(trip(), "out")
    log = records.read_log(tmp_path / "out" / "trip-0000.parquet")
    vessel, own = log.vessel.to_dict(), tmp_path / "own.json"
    own.write_text(json.dumps(vessel))
    path = trip(text=TRIP.replace('"cargo90"', json.dumps(str(own))))
    go(path, "own")
    vessel["dimensions"]["beam_m"] = 14.1
    own.write_text(json.dumps(vessel))
    with pytest.raises(InputError, match=r"vessel.parameters.dimensions.beam_m is 14.0 there, 14.1 here"):
        go(path, "own")


def test_scenario_that_cannot_be_simulated_leaves_nothing(trip, go, tmp_path):
    """Contract: one line on the scenario and no manifest, which would bar the mended one; nor does one without logs."""
    path = trip()
    mended = path.read_text()
    path.write_text(mended.replace("hold_s", "rudder_deg = 60\nhold_s"))
    with pytest.raises(InputError, match=r"manoeuvre.rudder_deg = 60 is beyond") as error:
        go(path, "out", workers=2)
    assert "complete" not in str(error.value) and not (tmp_path / "out").exists()
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "trip.manifest.json").write_text('{"campaign": "another"}')
    path.write_text(mended)
    assert go(path, "out") == go(path, "whole")


def test_log_of_something_else_is_not_overwritten(trip, go, tmp_path):
    """Contract: a log under the name of a voyage that no campaign made, or another one, stays."""
    go(trip(duration=31), "other")
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "trip-0003.parquet").write_bytes((tmp_path / "other" / "trip-0003.parquet").read_bytes())
    before = contents(tmp_path / "out")
    with pytest.raises(InputError, match=r"trip-0003.parquet: is there, and not of this campaign; give another --out"):
        go(trip(), "out")
    assert contents(tmp_path / "out") == before


def test_damaged_and_changed_files_are_made_again(trip, go, tmp_path):
    """Oracle: the untouched folder. An empty log, a cut truth, a missing truth, a log rewritten since, one voyage under another's name."""
    whole, out = go(trip(), "out"), tmp_path / "out"
    (out / "trip-0000.parquet").write_bytes(b"")
    (out / "trip-0001.truth.parquet").write_bytes(whole["trip-0001.truth.parquet"][:5000])
    (out / "trip-0002.truth.parquet").unlink()
    pq.write_table(pq.read_table(out / "trip-0003.parquet"), out / "trip-0003.parquet", compression="none")
    (out / "trip-0004.parquet").write_bytes(whole["trip-0001.parquet"])
    assert go(trip(), "out") == whole


def test_campaign_grows_and_keeps_what_it_has(trip, go, tmp_path):
    """Oracle: the larger campaign made at once; asking for fewer voyages afterwards leaves all in the manifest."""
    go(trip(), "out", voyages=2)
    first = (tmp_path / "out" / "trip-0001.parquet").stat().st_mtime_ns
    larger = go(trip(), "out")
    assert (tmp_path / "out" / "trip-0001.parquet").stat().st_mtime_ns == first
    assert larger == go(trip(), "whole") == go(trip(), "out", voyages=2)


def test_seeds_share_a_folder(trip, go):
    """Contract: a seed in place of the scenario's has names and a manifest of its own."""
    seven = go(trip(), "out")
    both = go(trip(), "out", seed=8)
    assert {name: both[name] for name in seven} == seven
    assert sorted(set(both) - set(seven)) == sorted(name.replace("trip", "trip-s8") for name in seven)


def test_workers_load_no_network(trip):
    """sys.modules of a fresh interpreter that imports what a worker does."""
    modules = modules_after("import aspnn.simulation.campaign")
    assert "pyarrow" in modules
    assert not modules & {"torch", "lightning", "matplotlib", "plotly", "sklearn", "filterpy", "dask"}


def test_missing_dask_is_said(trip, go, monkeypatch):
    """Contract: one line with the remedy."""
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match=r"--scheduler needs Dask; install it with pip install 'aspnn\[scale\]'"):
        go(trip(), "out", scheduler="local")


def test_dask_makes_the_same_files(trip, go, monkeypatch):
    """Oracle: the files that this process makes, byte by byte; and one line where no scheduler answers."""
    distributed = pytest.importorskip("distributed")
    one = go(trip(), "one")
    assert go(trip(), "local", workers=2, scheduler="local") == one
    with distributed.LocalCluster(1, threads_per_worker=1, dashboard_address=None) as cluster:
        assert go(trip(), "remote", workers=None, scheduler=cluster.scheduler_address) == one
    monkeypatch.setattr(campaign, "CONNECT", 2)
    with (
        pytest.raises(InputError, match="no Dask scheduler with workers answers there"),
        contextlib.suppress(TimeoutError),
    ):
        go(trip(), "none", workers=None, scheduler="tcp://127.0.0.1:9")
