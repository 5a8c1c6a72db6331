"""Start of a command: what it does not need is not imported."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from scex_sumo.scenarios import example_path


def test_a_run_does_without_pandas_and_most_of_scipy(tmp_path: Path) -> None:
    pytest.importorskip("pandas")
    code = (
        "import sys\nfrom scex_sumo.cli import main\n"
        f"sys.argv = ['scex-sumo', 'run', {str(example_path('motorway_merge'))!r}, '--children', '1', "
        f"'--steps', '3', '-o', {str(tmp_path / 'out')!r}]\nmain()\n"
        "print({'pandas', 'scipy.special', 'scipy.sparse', 'scipy.linalg', 'torch'} & set(sys.modules))\n"
        "import pyarrow as pa\n"
        "print(type(pa.table({'a': [1]}).to_pandas()).__name__)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-2:] == ["set()", "DataFrame"]
