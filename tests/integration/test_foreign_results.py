"""Result folders of strangers: names in files are data; no command that reads a folder runs code for them."""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from scex_sumo import example_path, read_seed
from scex_sumo.results.run import Run
from tests.command import status
from tests.runs import extrapolate

EVIL = "from pathlib import Path\nPath(__file__).with_name('executed').touch()\ndef risk(scenes): ...\n"
READERS: dict[str, Callable[[Path], list[object]]] = {
    "encounters": lambda out: [out],
    "report": lambda out: [out],
    "view": lambda out: [out, "--future", "1", "--write-only"],
    "export": lambda out: [out, "--future", "1", "--to", "interaction", "-o", out.with_name("future.csv")],
    "plot": lambda out: [out, out.with_name("other")],
    "metrics": lambda out: [out, "-o", out.with_name("metrics.csv")],
}


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    out = tmp_path_factory.mktemp("run") / "out"
    return extrapolate(read_seed(example_path("roundabout")), futures=6, out=out)


@pytest.fixture
def foreign(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a column ``evil:risk``, beside an ``evil.py`` that leaves a file when it is run."""
    out = tmp_path / "out"
    shutil.copytree(run.folder, out)
    (tmp_path / "evil.py").write_text(EVIL)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    for name in ("metrics.parquet", "recorded.parquet"):
        table = pq.read_table(out / name)
        for column in ("evil:risk", "evil:risk_mean"):
            table = table.append_column(column, pa.array(np.linspace(0.0, 1.0, table.num_rows)))
        pq.write_table(table, out / name)
    return out


@pytest.mark.parametrize("command", READERS)
@pytest.mark.parametrize("described", [False, True])
def test_a_column_named_like_a_module_is_never_imported(
    foreign: Path, command: str, described: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    if described:
        info: dict[str, Any] = json.loads((foreign / "run.json").read_text())
        info["metrics"] = [{"name": "evil:risk", "critical": "max", "function": "evil:risk", "label": "risk"}]
        (foreign / "run.json").write_text(json.dumps(info))
    shutil.copytree(foreign, foreign.with_name("other"))
    code = status(command, *READERS[command](foreign))
    said = capsys.readouterr()
    assert not (foreign.parent / "executed").exists() and "evil" not in sys.modules
    assert "Traceback" not in said.err
    if described and command != "metrics":
        assert code == 0, said.err
    elif code:
        assert said.err.startswith("error: ") and said.err.count("\n") == 1


def test_a_column_that_nothing_describes_is_named_with_its_file(
    foreign: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert status("report", foreign) == 1
    said = capsys.readouterr().err
    assert f"{foreign / 'metrics.parquet'}: column 'evil:risk' is no metric that run.json describes" in said
