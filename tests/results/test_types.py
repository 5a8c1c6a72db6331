"""Type checkers know the tables of a run, although pyarrow ships no types."""

from __future__ import annotations

from pathlib import Path

from mypy import api

import scex_sumo

PACKAGE = Path(scex_sumo.__file__).parent


def test_a_checker_knows_the_tables_of_a_run(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    lines = "from scex_sumo.results.run import open_run", "run = open_run('out')"
    script.write_text("\n".join([*lines, "run.metrics.num_rows + run.table('worst.parquet').rows"]))
    # Without the modules that these import, which takes a second instead of a minute.
    ours = [str(PACKAGE / file) for file in ("results/run.py", "base/arrow.pyi", "base/arguments.py")]
    said, _, _ = api.run([str(script), *ours, "--follow-imports=skip", f"--cache-dir={tmp_path}"])
    (error,) = (line for line in said.splitlines() if "script.py" in line)
    assert '"ArrowTable" has no attribute "rows"' in error
