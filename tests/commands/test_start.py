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


def test_a_run_does_without_torch_and_most_of_scipy_and_a_second_one_without_lanelet2(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The second run has rule-based drivers alone, and loads no wing of drivers."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    wings = tuple(f"scex_sumo.{room}" for room in ("humans.driver", "humans.guard", "learned", "plug_in"))
    code = (
        f"print({NEVER!r} & set(sys.modules))\nprint('lanelet2' in sys.modules)\n"
        f"print(any(name.startswith({wings!r}) for name in sys.modules))"
    )
    assert after_a_run(tmp_path, code) == ["set()", "True", "True"]
    assert after_a_run(tmp_path, code, *ALONE, "--models", "rules") == ["set()", "False", "False"]
