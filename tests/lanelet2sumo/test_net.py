"""Writer of nets: it loads what a map needs."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from scex_sumo import example_path

CODE = """
import sys
from pathlib import Path
import scex_sumo
scex_sumo.convert(scex_sumo.read_map(sys.argv[1]), Path(sys.argv[2]))
print(*{"footways", "lights", "pedestrians"} & {name.rpartition(".")[2] for name in sys.modules})
"""


@pytest.mark.parametrize(
    ("name", "loaded"), [("roundabout", set()), ("urban_intersection", {"footways", "pedestrians"})]
)
def test_footways_are_planned_where_the_map_has_some(name: str, loaded: set[str], tmp_path: Path) -> None:
    command = [sys.executable, "-c", CODE, str(example_path(name)), str(tmp_path / "a.net.xml")]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert set(done.stdout.split()) == loaded
