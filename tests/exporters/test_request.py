from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from scex_sumo.base.errors import MapError, UsageError
from scex_sumo.exporters.request import EXPORTERS, Request, closest_encounters, critical_children
from scex_sumo.results.run import Run


def test_the_most_critical_children_come_worst_first(run: Run) -> None:
    children = critical_children(run, "wttc", 3)
    values = run.metrics["wttc"].to_numpy()
    assert children[0] == run.most_critical("wttc")
    assert list(values[list(children)]) == sorted(values)[:3]
    with pytest.raises(UsageError, match="unknown metric 'nonsense'; nearest: "):
        critical_children(run, "nonsense", 1)


def test_the_typical_future_of_an_encounter_is_that_of_view(run: Run) -> None:
    for row in run.encounters.to_pylist():
        assert closest_encounters(run, row["other_id"], row["track_id"], 1) == (row["child"],)


def test_encounters_are_sorted_by_the_gap_of_the_two(run: Run) -> None:
    first, second = run.scene.track_ids[:2].tolist()
    order = closest_encounters(run, first, second, 4)
    met = next(
        (r for r in run.encounters.to_pylist() if {r["track_id"], r["other_id"]} == {first, second}), None
    )
    assert met is None or order[0] == met["child"]
    apart = []
    for child in order[met is not None :]:
        now = run.states(child)[:, 10:]
        apart.append(np.hypot(now.x[0] - now.x[1], now.y[0] - now.y[1]).min())
    assert sorted(order) == [0, 1, 2, 3] and apart[0] <= apart[-1] + 1.0  # boxes, not centres
    with pytest.raises(UsageError, match="no vehicle 999; known: 1"):
        closest_encounters(run, first, 999, 1)


def test_a_map_that_is_gone_is_asked_for(run: Run, tmp_path: Path) -> None:
    request = Request(run=run, children=(0,), map_path=tmp_path / "gone.osm")
    with pytest.raises(MapError, match="give it with --map MAP"):
        _ = request.road


def test_an_exporter_of_ones_own_is_named_by_its_import_path(run: Run) -> None:
    write = EXPORTERS.load("tests.exporters.test_request:write_nothing")
    assert write(Request(run=run, children=(1,))) == [Path("1")]
    with pytest.raises(UsageError, match="known: interaction, fcd, openscenario, sumo"):
        EXPORTERS.load("word")


def write_nothing(request: Request) -> list[Path]:
    return [Path(str(child)) for child in request.children]


def test_all_children_are_cases_of_one_interaction_file(run: Run, tmp_path: Path) -> None:
    (file,) = EXPORTERS.load("interaction")(Request(run=run, children=(0, 1, 2, 3), out=tmp_path / "all.csv"))
    lines = file.read_text().splitlines()
    assert len(lines) == 1 + 4 * run.scene.vehicles * 40
    assert lines[0].startswith("case_id,track_id,frame_id")
