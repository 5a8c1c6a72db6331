"""Tables of result folders that somebody edited: one line, no traceback."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from scex_sumo.base.errors import ResultError
from scex_sumo.results.tables.reading import read_metrics


@pytest.mark.parametrize("values", [[[True], [False]], [True, None], ["yes", "no"]])
def test_collisions_that_are_no_truth_values_are_refused(tmp_path: Path, values: list[Any]) -> None:
    file = tmp_path / "metrics.parquet"
    pq.write_table(pa.table({"future": [0, 1], "wttc": [0.5, 0.1], "collision": values}), file)
    with pytest.raises(ResultError, match="column collision holds no numbers; run again"):
        read_metrics(file, rows=2)
