"""The command line as a user meets it: results, and one line for everything that is wrong."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pyarrow.parquet as pq
import pytest

import scex_sumo
from scex_sumo.base.sumo.programs import program
from scex_sumo.metrics.registry import COLUMNS, columns_of, metrics_named
from tests.command import ALONE, scex

BOTH = columns_of(metrics_named(["paper", "path"]))
DRIVEN = [name for name in columns_of(metrics_named(["paper"])) if not name.startswith("gap_time")]
"""Columns that no plan changes."""
TABLES = (
    *("tracks", "metrics", "assignments", "densities"),
    *("worst", "collisions", "encounters", "recorded"),
)
ROUNDABOUT = scex_sumo.example_path("roundabout")
QUICK = ("--no-plots", *ALONE)
MAP_HEAD = '<?xml version="1.0"?>\n<osm version="0.6">\n'


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small run of an example seed."""
    out = tmp_path_factory.mktemp("run") / "out"
    done = scex("run", ROUNDABOUT, "--futures", 12, *QUICK, "-o", out)
    assert done.returncode == 0, done.stderr
    return out


def refused(*arguments: object, status: int = 1) -> str:
    """The one line that a refused command prints."""
    done = scex(*arguments)
    assert done.returncode == status, (done.stdout, done.stderr)
    lines = [line for line in done.stderr.splitlines() if not line.startswith("note: ")]
    assert len(lines) == 1, done.stderr
    assert lines[0].startswith("error: ")
    return lines[0]


def test_a_run_leaves_the_result_that_the_readme_promises(result: Path) -> None:
    info = json.loads((result / "run.json").read_text())
    assert info["futures"] == 12
    assert info["steps"] == 30
    metrics = pq.read_table(result / "metrics.parquet")
    assert metrics.column_names == ["future", *BOTH, "collision"] and BOTH[:12] == COLUMNS
    assert metrics["future"].to_pylist() == list(range(12))
    tracks = pq.read_table(result / "tracks.parquet")
    assert tracks.num_rows == 12 * info["seed_scene"]["vehicles"] * 40
    assert pq.read_table(result / "assignments.parquet").num_rows == 12 * info["seed_scene"]["vehicles"]
    assert pq.read_table(result / "recorded.parquet").num_rows == 1
    assert set(pq.read_table(result / "densities.parquet")["metric"].to_pylist()) <= set(BOTH)
    assert (result / "seed.csv").read_text().startswith("case_id,track_id,frame_id")
    assert not (result / "incomplete.json").exists()
    said = repr(scex_sumo.open_run(result))
    assert said.startswith(f"Run({str(result)!r}: 12 futures of roundabout_t4.5, a collision in ")


def test_one_vehicle_is_run_and_its_metrics_of_pairs_are_shown_as_undefined(tmp_path: Path) -> None:
    out = tmp_path / "a single one"
    done = scex("run", ROUNDABOUT, "--synthetic", 1, "--futures", 2, "--preset", "both", "-o", out)
    assert done.returncode == 0, done.stderr
    assert "1 vehicle, 2 futures" in done.stdout
    assert done.stdout.count(" 0/2") == 13
    assert f"scex-sumo view '{out}'" in done.stdout
    densities = pq.read_table(out / "densities.parquet")
    assert densities.num_rows == 0
    assert densities.column_names == ["metric", "x", "pdf", "cdf", "low", "high", "atom"]


def test_the_same_seed_gives_the_same_bytes_whatever_the_batches_and_workers(
    result: Path, tmp_path: Path
) -> None:
    for workers, vehicles in ((1, 70), (2, 28)):
        out, options = tmp_path / str(workers), ("--futures", 12, "--workers", workers, *QUICK)
        done = scex("run", ROUNDABOUT, *options, "-o", out, vehicles=vehicles)
        assert done.returncode == 0, done.stderr
        for table in TABLES:
            name = f"{table}.parquet"
            assert (out / name).read_bytes() == (result / name).read_bytes(), (options, name)


def same_values(result: Path, evaluated: Path) -> None:
    """The run's own metrics of tracks alone, which the evaluated ones equal to the last digits."""
    mine, again = pq.read_table(result / "metrics.parquet"), pq.read_table(evaluated)
    assert again["case_id"].to_pylist() == mine["future"].to_pylist()
    for column in DRIVEN:
        assert again[column].is_null().equals(mine[column].is_null()), column
        known = mine[column].drop_null().to_pylist()
        assert again[column].drop_null().to_pylist() == pytest.approx(known, rel=1e-9, abs=1e-9), column


def test_long_futures_are_evaluated_again_in_windows(tmp_path: Path) -> None:
    """Tracks of 200 steps and more are cut, history included."""
    options = ("--futures", 2, "--steps", 195, "--replan", 17, *QUICK)
    done = scex("run", ROUNDABOUT, *options, "-o", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    assert scex("metrics", tmp_path / "out", "-o", tmp_path / "again.parquet").returncode == 0
    same_values(tmp_path / "out", tmp_path / "again.parquet")


def test_an_interrupted_run_is_resumed_to_the_same_bytes(result: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    script = (
        "import scex_sumo, sys\n"
        "def stop(done, total):\n"
        "    if done >= 6 * 30 + 5: raise KeyboardInterrupt\n"
        f"seed = scex_sumo.read_seed({str(ROUNDABOUT)!r})\n"
        "import scex_sumo.extrapolation.job as job\n"
        "job.VEHICLES_AT_ONCE = 4 * seed.vehicles\n"
        f"options = dict(out={str(out)!r}, progress=stop)\n"
        "scex_sumo.extrapolate(seed, futures=12, reference=None, report=False, **options)\n"
    )
    stopped = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert "KeyboardInterrupt" in stopped.stderr
    assert (out / "incomplete.json").exists()
    assert not (out / "run.json").exists()
    assert "interrupted" in refused("view", out, "--future", 0)
    done = scex("run", ROUNDABOUT, "--futures", 12, *QUICK, "-o", out)
    assert done.returncode == 0, done.stderr
    for table in TABLES:
        name = f"{table}.parquet"
        assert (out / name).read_bytes() == (result / name).read_bytes(), name


def test_a_result_folder_with_a_comma_is_written_and_its_future_opens_in_sumo(tmp_path: Path) -> None:
    folder = tmp_path / "a,b" / "c,d"
    options = ["--futures", "2", "--steps", "3", "--models", "sumo:EIDM", "--reference", "none"]
    done = scex("run", scex_sumo.example_path("roundabout"), *options, "-o", folder)
    assert done.returncode == 0, done.stderr
    shown = scex("view", folder, "--future", "1", "--write-only")
    assert shown.returncode == 0, shown.stderr
    file = Path(shown.stdout.strip())
    command = [program("sumo"), "-c", file.name]
    opened = subprocess.run(command, cwd=file.parent, capture_output=True, text=True, timeout=60, check=False)
    assert opened.returncode == 0, opened.stderr


def test_thresholds_are_the_users_where_given(tmp_path: Path) -> None:
    options = ["--futures", 3, "--threshold", "pttc=100", "--threshold", "distance=0", *QUICK]
    done = scex("run", ROUNDABOUT, *options, "-o", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    run = scex_sumo.open_run(tmp_path / "out")
    assert run.p_critical("pttc").value == 1.0
    assert run.p_critical("distance").value == 0.0
    assert run.thresholds["tq"] == 1.2


def test_every_combination_is_run_on_request(tmp_path: Path) -> None:
    vehicles = scex_sumo.read_seed(ROUNDABOUT).track_ids.tolist()
    fixed = [f"--assign={track}=constant_velocity" for track in vehicles[3:]]
    models = "constant_velocity,emergency_brake"
    done = scex(
        "run", ROUNDABOUT, "--futures", "all", "--models", models, *fixed, *QUICK, "-o", tmp_path / "out"
    )
    assert done.returncode == 0, done.stderr
    assert pq.read_table(tmp_path / "out" / "metrics.parquet").num_rows == 8


def test_export_writes_an_interaction_case_and_fcd(result: Path, tmp_path: Path) -> None:
    for to, name in (("interaction", "future.csv"), ("fcd", "future.fcd.xml")):
        done = scex("export", result, "--future", 3, "--to", to, "-o", tmp_path / name)
        assert done.returncode == 0, done.stderr
    seed = scex_sumo.read_seed(ROUNDABOUT, tracks=tmp_path / "future.csv")
    assert seed.vehicles == scex_sumo.read_seed(ROUNDABOUT).vehicles
    assert (tmp_path / "future.fcd.xml").read_text().count("<timestep ") == 40


@pytest.mark.parametrize(
    ("content", "words"),
    [("not a map at all", "XML"), (MAP_HEAD + "</osm>", "lanelet"), ("<net></net>", "lanelet"), ("", "XML")],
)
def test_what_is_no_map_is_said(tmp_path: Path, content: str, words: str) -> None:
    path = tmp_path / "map.osm"
    path.write_text(content)
    assert words.lower() in refused("run", path, "--synthetic", 3).lower()
    assert words.lower() in refused("run", path).lower()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--models", "granny"], "unknown behavior 'granny'; nearest: "),
        (["--models", "standard_driver@many"], "many"),
        (["--models", "standard_driver:courage=9"], "courage"),
        (["--futures", "0"], "--futures"),
        (["--futures", "some"], "--futures"),
        (["--futures", "all"], "combinations"),
        (["--replan", "31"], "--replan"),
        (["--steps", "0"], "--steps"),
        (["--assign", "17"], "TRACK=MODEL"),
        (["--threshold", "ttc"], "METRIC=VALUE"),
        (["--threshold", "speed=3"], "unknown metric 'speed'"),
        (["--threshold", "ttc=nan"], "ttc=nan"),
        (["--assign", "99999=replay"], "99999"),
        (["--synthetic", "3", "--case", "1"], "--case"),
        (["--origin", "here"], "here"),
        (["--workers", "0"], "--workers"),
        (["--seed", "-1"], "--seed"),
    ],
)
def test_options_that_make_no_sense_are_usage_errors(tmp_path: Path, options: list[str], words: str) -> None:
    line = refused("run", ROUNDABOUT, "-o", tmp_path / "out", *options, status=2)
    assert words in line
    assert not (tmp_path / "out").exists()


def test_tracks_far_from_the_map_name_the_origin_as_likely_cause(tmp_path: Path) -> None:
    rows = ROUNDABOUT.with_suffix(".csv").read_text().splitlines()
    names = rows[0].split(",")
    x = names.index("x")
    moved = [rows[0]]
    for row in rows[1:]:
        cells = row.split(",")
        cells[x] = str(float(cells[x]) + 5000) if cells[x] else ""
        moved.append(",".join(cells))
    (tmp_path / "far.csv").write_text("\n".join(moved))
    options = ["--tracks", tmp_path / "far.csv", "-o", tmp_path / "out"]
    assert "origin" in refused("run", ROUNDABOUT, *options)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_run_interrupted_while_it_reads_says_so_and_fails(tmp_path: Path, number: int) -> None:
    code = (
        "import atexit, os, sys, time, scex_sumo.scenarios.seeds, scex_sumo.__main__\n"
        "class Library:  # as Arrow, interrupted while it imports pandas\n"
        "    __del__ = lambda self: os.abort()\n"
        "library = Library()\n"
        "atexit.register(print, 'cleaned')\n"
        "def reading(*given, **named):\n"
        f"    os.kill(os.getpid(), {int(number)})\n"
        "    time.sleep(30)  # the signal may take a moment\n"
        "scex_sumo.scenarios.seeds.read_seed = reading\n"
        f"sys.argv = ['scex-sumo', 'run', {str(ROUNDABOUT)!r}]\n"
        "scex_sumo.__main__.start()\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, cwd=tmp_path, check=False
    )
    assert (done.returncode, done.stderr.strip(), done.stdout) == (130, "interrupted", "cleaned\n")
    assert not (tmp_path / "out").exists()


def test_files_and_threads_of_a_users_code_end_with_the_command(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(
        "import threading, time\n"
        "log = open('log.txt', 'w')\n"
        "log.write('imported')\n"
        "def late():\n"
        "    time.sleep(0.5)\n"
        "    open('late.txt', 'w').write('done')\n"
        "threading.Thread(target=late).start()\n"
        "class Driver:\n"
        "    def plan_one(self, history, road, future, vehicle, rng): ...\n"
    )
    command = [sys.executable, "-m", "scex_sumo", "models", "mine:Driver"]
    subprocess.run(command, cwd=tmp_path, check=True, capture_output=True)
    assert [(tmp_path / name).read_text() for name in ("log.txt", "late.txt")] == ["imported", "done"]


def test_a_command_without_standard_error_works(tmp_path: Path) -> None:
    command = f"{sys.executable} -m scex_sumo --version 2>&-"
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (0, f"scex-sumo {scex_sumo.__version__}\n")


def test_a_disk_that_is_full_is_said_in_one_line(tmp_path: Path) -> None:
    """A limit on the size of files stands for the disk: the tables of 40 futures are larger."""
    limited = f"ulimit -f 100; exec {sys.executable} -m scex_sumo run {ROUNDABOUT} --no-plots"
    command = ["bash", "-c", f"{limited} --futures 40 --workers 2 -o {tmp_path}/out"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 1, done.stdout
    lines = [line for line in done.stderr.splitlines() if not line.startswith("note: ")]
    assert len(lines) == 1, done.stderr
    assert "File too large" in lines[0]
    assert not (tmp_path / "out" / "run.json").exists()


def test_the_package_imports_nothing_heavy() -> None:
    code = (
        "import sys, scex_sumo.cli\n"
        "names = {'numpy', 'torch', 'libsumo', 'lanelet2', 'matplotlib', 'scipy', 'pyarrow', 'shapely'}\n"
        "heavy = names & set(sys.modules)\n"
        "assert not heavy, heavy\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True, env={**os.environ})


def test_a_result_with_a_colon_in_its_relative_name_is_read_and_evaluated(tmp_path: Path) -> None:
    """Arrow takes such a name for a URI."""
    name = "file:x"
    for arguments in (
        ("run", ROUNDABOUT, "--futures", 2, "--steps", 5, "-o", name),
        ("report", name),
        ("metrics", name, "-o", "again:1.parquet"),
        ("metrics", f"{name}/tracks.parquet", "-o", "again:2.parquet"),
    ):
        done = scex(*arguments, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
    assert (tmp_path / name / "run.json").is_file() and (tmp_path / "again:2.parquet").is_file()


def test_a_comma_in_the_folder_for_temporary_files_is_one_line(tmp_path: Path) -> None:
    folder = tmp_path / "a,b"
    folder.mkdir()
    environment = {**os.environ, "TMPDIR": str(folder)}
    done = scex("run", ROUNDABOUT, "--futures", 2, "-o", "out", cwd=tmp_path, env=environment)
    assert done.returncode == 1
    assert "SUMO splits paths at commas; set TMPDIR to one without" in done.stderr.splitlines()[-1]
