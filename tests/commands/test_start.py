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


def test_a_command_does_not_load_pandas_for_arrow() -> None:
    pytest.importorskip("pandas")
    tracks = example_path("roundabout").with_suffix(".csv")
    words = ["-X", "importtime", "-m", "scex_sumo", "metrics", str(tracks)]
    done = subprocess.run([sys.executable, *words], capture_output=True, text=True, check=True)
    assert "pyarrow.lib" in done.stderr and "pandas.core" not in done.stderr


def test_pandas_and_arrow_work_together_all_the_same() -> None:
    pytest.importorskip("pandas")
    script = (
        "import sys; from scex_sumo.base.importing import import_arrow; import_arrow()\n"
        "import pyarrow as pa; pa.table({'a': [1]}).to_pylist(); assert 'pandas' not in sys.modules\n"
        "import pandas as pd; frame = pd.DataFrame({'a': [1]})\n"
        "assert pa.table(frame).to_pandas().equals(frame) and pa.array(frame['a']).to_pylist() == [1]\n"
    )
    subprocess.run([sys.executable, "-c", script], check=True)
