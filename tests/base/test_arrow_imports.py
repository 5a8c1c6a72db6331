"""Import of Arrow without pandas, in a process of its own."""

import subprocess
import sys

CODE = """
import sys
from scex_sumo.base.arrow_imports import import_arrow_alone
import_arrow_alone()
import pyarrow as pa
table = pa.table({"a": [1, 2], "b": ["x", None]})
table["a"].to_numpy()
assert "pandas" not in sys.modules
frame = table.to_pandas()
assert frame["a"].tolist() == [1, 2]
assert pa.Table.from_pandas(frame)["a"].to_pylist() == [1, 2]
"""


def test_arrow_loads_pandas_only_for_data_frames() -> None:
    subprocess.run([sys.executable, "-c", CODE], check=True)
