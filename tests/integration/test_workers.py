"""Processes that share a run: what dies, fails or is interrupted in one of them."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

import scex_sumo

ROUNDABOUT = scex_sumo.example_path("roundabout")

# A driver of the user's own script, which helpers do not run. The first process waits with its plans until
# the flag is there: until then the helper has taken no batch.
SCRIPT = """
import os, signal, sys, time
from pathlib import Path
import numpy as np
import scex_sumo
import scex_sumo.extrapolation.job as job

FIRST, FLAG = os.getpid(), Path(sys.argv[1]) / "flag"

def in_helper():
    {in_helper}

@scex_sumo.behavior("straight")
class Straight:
    def plan(self, history, road, who, rng):
        if os.getpid() != FIRST:
            in_helper()
            FLAG.touch()
        elif history.step > 0 and sys.argv[2] == "2":
            until = time.monotonic() + 60
            while not FLAG.exists() and time.monotonic() < until:
                time.sleep(0.01)
        now = history.now[who.future, who.vehicle]
        way = now.speed[:, None] * 0.1 * np.arange(1, 31)
        turn = now.heading[:, None]
        return scex_sumo.Plan(
            x=now.x[:, None] + way * np.cos(turn),
            y=now.y[:, None] + way * np.sin(turn),
            heading=np.repeat(turn, 30, axis=1),
            speed=np.repeat(now.speed[:, None], 30, axis=1),
        )

if __name__ == "__main__":
    seed = scex_sumo.read_seed({seed!r})
    job.VEHICLES_AT_ONCE = 2 * seed.vehicles
    out = Path(sys.argv[1]) / sys.argv[2]
    scex_sumo.extrapolate(
        seed,
        models=["straight"],
        futures=6,
        workers=int(sys.argv[2]),
        replan=15,
        reference=None,
        report=False,
        out=out,
    )
"""

NEW_PROCESSES = True


def ran(folder: Path, in_helper: str, workers: int = 2) -> subprocess.CompletedProcess[str]:
    """The script's run in a folder; ``in_helper`` is what a helper does when it first plans."""
    script = folder / "script.py"
    script.write_text(SCRIPT.format(in_helper=in_helper, seed=str(ROUNDABOUT)))
    command = [sys.executable, str(script), str(folder), str(workers)]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)


def test_a_script_needs_no_guard_and_its_worker_that_dies_is_replaced_which_changes_no_byte(
    tmp_path: Path,
) -> None:
    for workers in (1, 2):
        done = ran(
            tmp_path, "if not FLAG.exists(): FLAG.touch(); os.kill(os.getpid(), signal.SIGKILL)", workers
        )
        assert done.returncode == 0, done.stderr
    assert (tmp_path / "flag").exists()  # a helper has planned
    info = json.loads((tmp_path / "2" / "run.json").read_text())
    assert [note for note in info["run_notes"] if "died" in note and "signal 9" in note]
    for name in ("tracks", "metrics"):
        assert (tmp_path / "1" / f"{name}.parquet").read_bytes() == (
            tmp_path / "2" / f"{name}.parquet"
        ).read_bytes()


def test_a_run_that_is_over_before_its_workers_are_ready_ends_them_and_says_nothing_of_it(
    tmp_path: Path,
) -> None:
    code = (
        "import scex_sumo\n"
        "from scex_sumo.extrapolation.engine import run_scene\n"
        "from scex_sumo.extrapolation.options import RunOptions\n"
        "from scex_sumo.extrapolation.settings import RunSettings\n"
        "from scex_sumo.extrapolation.processes.workers import Workers\n"
        f"seed = scex_sumo.read_seed({str(ROUNDABOUT)!r})\n"
        "with Workers(2) as workers:\n"
        "    for number in range(2):\n"
        "        settings = RunSettings(futures=2, steps=1, seed=number)\n"
        "        run, _ = run_scene(seed, settings, workers=workers, options=RunOptions())\n"
        "        assert run.futures == 2\n"
        "        assert run.info['run_notes'] == [], run.info['run_notes']\n"
        "assert workers.deaths == []\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_a_worker_that_dies_twice_over_a_batch_ends_the_run_resumably(tmp_path: Path) -> None:
    done = ran(tmp_path, "FLAG.touch(); os.kill(os.getpid(), signal.SIGKILL)")
    assert done.returncode == 1
    last = done.stderr.strip().splitlines()[-1]
    assert "SimulationError: a worker died twice during futures" in last and "signal 9" in last
    assert (tmp_path / "2" / "incomplete.json").exists()


@pytest.mark.parametrize("workers", [1, 2])
def test_too_little_address_space_is_one_line(tmp_path: Path, workers: int) -> None:
    """Libsumo and Arrow crash while they are loaded, which no exception tells."""
    command = [sys.executable, "-m", "scex_sumo", "run", str(ROUNDABOUT), "--workers", str(workers)]
    limited = ["bash", "-c", 'ulimit -v 1400000; exec "$@"', "bash", *command, "-o", str(tmp_path / "out")]
    done = subprocess.run(limited, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 1
    (line,) = done.stderr.splitlines()
    assert line.startswith("error: ulimit -v leaves each process 1.4 GB of address space")


@pytest.mark.skipif(not Path("/proc").is_dir(), reason="finds processes in /proc")
def test_ctrl_c_ends_all_processes_and_leaves_what_was_finished(tmp_path: Path) -> None:
    out = tmp_path / "out"
    options = ["--futures", "1000", "--workers", "2", "--no-plots"]
    code = "import scex_sumo.extrapolation.job as job; job.VEHICLES_AT_ONCE = 112\n"
    code += "from scex_sumo.cli import main; main()"
    command = [sys.executable, "-c", code, "run", str(ROUNDABOUT), *options, "-o", str(out)]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as run:
        until = time.monotonic() + 60
        while len(list(out.glob(".parts/*.npz"))) < 3 and time.monotonic() < until:
            time.sleep(0.02)
        helpers = futures_of(run.pid)
        os.kill(run.pid, signal.SIGINT)
        _, said = run.communicate(timeout=60)
    assert run.returncode == 130
    assert said.splitlines()[-1].endswith(" keeps finished futures; run the same command to go on")
    assert len(helpers) == 1
    assert not any(Path(f"/proc/{helper}").exists() for helper in helpers)
    assert list(out.glob(".parts/*.npz")) and (out / "incomplete.json").exists()


def futures_of(pid: int) -> list[int]:
    """Processes that a process has started, from their ``stat``: pid (name) state parent ..."""
    found = []
    for file in Path("/proc").glob("[0-9]*/stat"):
        try:
            parent = int(file.read_text().rpartition(")")[2].split()[1])
        except OSError:  # it has ended meanwhile
            continue
        if parent == pid:
            found.append(int(file.parent.name))
    return found
