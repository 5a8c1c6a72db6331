"""Start of a command: what it does not need is not imported."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from scex_sumo.scenarios import example_path
from tests.command import ALONE

NEVER = {"scipy.sparse", "scipy.linalg", "torch"}


def after_a_run(tmp_path: Path, code: str, *more: str) -> list[str]:
    """What code prints after a run in the same process."""
    run = (
        "import sys\nfrom scex_sumo.cli import main\n"
        f"sys.argv = ['scex-sumo', 'run', {str(example_path('motorway_merge'))!r}, '--futures', '1', "
        f"'--steps', '3', '--overwrite', '-o', {str(tmp_path / 'out')!r}, *{more}]\nmain()\nprint()\n"
    )
    done = subprocess.run([sys.executable, "-c", run + code], capture_output=True, text=True, check=True)
    return done.stdout.rpartition("\n\n")[2].splitlines()


def test_a_run_does_without_torch_and_most_of_scipy(tmp_path: Path) -> None:
    assert after_a_run(tmp_path, f"print({NEVER!r} & set(sys.modules))") == ["set()"]


def test_a_second_run_on_a_map_does_without_lanelet2(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    code = "print('lanelet2' in sys.modules)"
    assert [after_a_run(tmp_path, code, *ALONE) for _ in range(2)] == [["True"], ["False"]]
