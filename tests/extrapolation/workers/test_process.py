"""Another interpreter: what it answers, how it ends, and that it stays ended."""

from __future__ import annotations

import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from scex_sumo.extrapolation.workers.forked import can_fork
from scex_sumo.extrapolation.workers.process import DIED, WorkerProcess

SERVING = """
import os, pickle, tempfile
from scex_sumo.extrapolation.workers.process import served_streams, write

def serve():
    orders, answers = served_streams()
    while True:
        order = pickle.load(orders)
        if isinstance(order, int):
            os._exit(order)
        print("heard")
        write(answers, (order, tempfile.gettempdir(), os.environ["OMP_NUM_THREADS"]))
"""


@pytest.fixture
def worker(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[WorkerProcess]:
    (tmp_path / "echo_worker.py").write_text(SERVING)
    monkeypatch.syspath_prepend(tmp_path)
    process = WorkerProcess("echo_worker", str(tmp_path))
    yield process
    process.kill()
    process.wait_for_exit()


def test_answers_come_whatever_is_printed_from_one_thread_with_its_files_in_the_folder(
    worker: WorkerProcess, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    for order in ("first", "second"):
        worker.send(order)
        assert worker.receive() == (order, str(tmp_path), "1")
    worker.kill()
    worker.wait_for_exit()
    assert capfd.readouterr().out == ""


def test_one_that_died_says_how_and_can_be_started_again(worker: WorkerProcess) -> None:
    worker.send(3)
    with pytest.raises(DIED):
        worker.receive()
    assert worker.exit_reason() == "exit status 3"
    worker.start()
    worker.send("again")
    assert worker.receive()[0] == "again"


def test_one_that_was_killed_stays_dead(worker: WorkerProcess) -> None:
    worker.kill()
    with pytest.raises(DIED):
        worker.receive()
    assert worker.exit_reason() == "signal 9"
    with pytest.raises(EOFError):
        worker.start()
    # The pipes are closed by now, which is no other error than that it has ended.
    with pytest.raises(EOFError):
        worker.send("order")
    with pytest.raises(EOFError):
        worker.receive()


COPYING = """
import os, pickle, sys, tempfile
import {module}
from scex_sumo.extrapolation.workers.forked import Forked, can_fork
from scex_sumo.extrapolation.workers.process import WorkerProcess, write

def serve():
    from scex_sumo.extrapolation.workers.process import served_streams
    orders, answers = served_streams()
    while True:
        write(answers, (pickle.load(orders), "json" in sys.modules, tempfile.gettempdir(), os.getpid()))

if __name__ == "__main__":
    assert can_fork()
    workers = [WorkerProcess("copying", sys.argv[1]) for _ in range(2)]
    assert all(isinstance(worker._process, Forked) for worker in workers)
    pids = set()
    for worker in workers:
        worker.send("order")
        order, has_json, folder, pid = worker.receive()
        assert (order, has_json, folder) == ("order", True, sys.argv[1])
        pids.add(pid)
    assert len(pids) == 2 and os.getpid() not in pids
    workers[0].kill()
    assert workers[0].exit_reason() == "signal 9"
    # The other one ends by itself when this one lets go of it: nobody else holds its pipes.
    workers[1]._process.stdin.close()
    assert workers[1]._process.wait(timeout=10) == 1
    print("done")
"""


def test_a_process_of_one_thread_is_copied_with_what_it_has_imported(tmp_path: Path) -> None:
    (tmp_path / "copying.py").write_text(COPYING.format(module="json"))
    run = [sys.executable, str(tmp_path / "copying.py"), str(tmp_path)]
    made = subprocess.run(run, capture_output=True, text=True, timeout=60, check=False)
    assert made.stdout == "done\n", made.stderr


def test_a_process_with_another_thread_is_not_copied() -> None:
    release = threading.Event()
    thread = threading.Thread(target=release.wait)
    thread.start()
    try:
        assert not can_fork()
    finally:
        release.set()
        thread.join()
