"""Another interpreter: what it answers, how it ends, and that it stays ended."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from scex_sumo.extrapolation.helper_process import DIED, HelperProcess

SERVING = """
import os, pickle, tempfile
from scex_sumo.extrapolation.helper_process import served_streams, write

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
def helper(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[HelperProcess]:
    (tmp_path / "echo_helper.py").write_text(SERVING)
    monkeypatch.syspath_prepend(tmp_path)
    process = HelperProcess("echo_helper", str(tmp_path))
    yield process
    process.kill()
    process.bury()


def test_answers_come_whatever_is_printed_from_one_thread_with_its_files_in_the_folder(
    helper: HelperProcess, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    for order in ("first", "second"):
        helper.send(order)
        assert helper.receive() == (order, str(tmp_path), "1")
    helper.kill()
    helper.bury()
    assert capfd.readouterr().out == ""


def test_one_that_died_says_how_and_can_be_started_again(helper: HelperProcess) -> None:
    helper.send(3)
    with pytest.raises(DIED):
        helper.receive()
    assert helper.fate() == "exit status 3"
    helper.start()
    helper.send("again")
    assert helper.receive()[0] == "again"


def test_one_that_was_killed_stays_dead(helper: HelperProcess) -> None:
    helper.kill()
    with pytest.raises(DIED):
        helper.receive()
    assert helper.fate() == "signal 9"
    with pytest.raises(EOFError):
        helper.start()
    # The pipes are closed by now, which is no other error than that it has ended.
    with pytest.raises(EOFError):
        helper.send("order")
    with pytest.raises(EOFError):
        helper.receive()
