"""Files are recognised without their readers; a declaration and the reader that it names agree."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from scex_sumo.converters.registries import Declaration
from scex_sumo.formats import declarations

DECLARED = {name: entry for name, entry in vars(declarations).items() if isinstance(entry, Declaration)}


def test_a_map_of_one_format_imports_no_reader_of_another_one(tmp_path: Path) -> None:
    code = f"""
import sys
from pathlib import Path
from scex_sumo.converters.registries import dataset_of, map_format
for name in ("map.osm", "01_tracks.csv", "log_map_archive_7.json"):
    map_format(Path({str(tmp_path)!r}, name)), dataset_of(Path({str(tmp_path)!r}, name))
print(*sorted(name for name in sys.modules if name.startswith("scex_sumo.formats.")))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = {name.removeprefix("scex_sumo.formats.") for name in done.stdout.split()}
    assert {"declarations", "argoverse"} <= loaded
    assert not any(name.startswith(("commonroad", "levelx", "py123d", "opendd", "spat")) for name in loaded)
