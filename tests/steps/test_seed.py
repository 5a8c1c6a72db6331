"""What a command says about its seed scene."""

from __future__ import annotations

from pathlib import Path

import pytest

from scex_sumo.base.errors import TrackError
from scex_sumo.scenarios.seeds import SeedOptions
from scex_sumo.steps.seed import seed_scene
from tests.converters import track_files
from tests.converters.maps import straight, write_map


@pytest.mark.parametrize(("beside", "shown"), [(1, "3"), (2, "2, 3")])
def test_vehicles_beside_the_lanes_are_counted_and_many_of_them_are_a_warning(
    beside: int, shown: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    where = "on no mapped lane of their direction"
    said = f"warning: {beside} of 3 vehicles are {where} and will drive straight ({shown})\n"
    map_path = write_map(tmp_path / "road.osm", [straight(1, 0, 300)])
    rows = []
    for k in range(3):
        rows += track_files.straight(k + 1, start=30.0 * k, y=1.75 + 20.0 * (k >= 3 - beside))
    csv = track_files.write_rows(tmp_path / "road.csv", rows)
    options = SeedOptions(tracks=csv, time=1.0)
    if beside == 2:
        with pytest.raises(TrackError, match=r"2 of 3 vehicles are on no mapped lane.*force=True"):
            seed_scene(map_path, options, seed=0, cache=False)
        return
    scene = seed_scene(map_path, options, seed=0, cache=False)
    assert capsys.readouterr().err.endswith(said)
    assert scene.notes[-1] == said.strip()  # for run.json and the report
