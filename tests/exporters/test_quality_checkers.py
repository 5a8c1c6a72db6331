from __future__ import annotations

from pathlib import Path

import pytest

from scex_sumo.converters.maps import read_map
from scex_sumo.exporters.opendrive.file import opendrive
from scex_sumo.exporters.request import EXPORTERS, Request
from scex_sumo.results.run import Run
from scex_sumo.scenarios import example_path
from tests.exporters.quality_checkers import checker, findings
from tests.formats.sumo.test_lanelets import EXAMPLES, SHARED

pytest.importorskip("scenariogeneration")
if checker(".xodr") is None or checker(".xosc") is None:
    pytest.skip("ASAM's quality checkers are not here; set SCEX_QC to their folder", allow_module_level=True)


@pytest.mark.parametrize("name", EXAMPLES)
def test_example_maps_as_opendrive_are_valid_by_asam_s_checker(name: str, tmp_path: Path) -> None:
    nothing_against(example_path(name), tmp_path)


@pytest.mark.parametrize("name", SHARED)
def test_real_maps_as_opendrive_are_valid_by_asam_s_checker(name: str, data: Path, tmp_path: Path) -> None:
    nothing_against(data / name, tmp_path)


def nothing_against(map_path: Path, folder: Path) -> None:
    file = folder / "map.xodr"
    file.write_text(opendrive(read_map(map_path)).text)
    assert findings(file) == []


def test_futures_as_openscenario_are_valid_by_asam_s_checker(run: Run, tmp_path: Path) -> None:
    files = EXPORTERS.load("openscenario")(Request(run=run, futures=(0, 1, 2, 3), out=tmp_path))
    assert [line for file in files if file.suffix in (".xosc", ".xodr") for line in findings(file)] == []
