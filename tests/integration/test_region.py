"""Region of a scene: pairs of its vehicles count; in large scenes, those too far away are replayed."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scex_sumo.base.errors import UsageError
from scex_sumo.reports.run_table import summary_table
from scex_sumo.results.obstacles import replaying
from scex_sumo.results.region import AROUND_M, Region, region_of
from scex_sumo.results.run import Run
from scex_sumo.scenarios import example_path
from scex_sumo.scenarios.seeds import read_seed
from scex_sumo.world.persons import obstacles_in_reach
from tests.behaviors import roads
from tests.runs import extrapolate


def rows_of(run: Run, name: str, vehicles: set[int]) -> list[dict[str, Any]]:
    """Rows of the pairs of some vehicles, without the intervals, which differ by rounding."""
    rows = [row for row in getattr(run, name).to_pylist() if {row["track_id"], row["other_id"]} & vehicles]
    return [{key: x for key, x in row.items() if not key.endswith(("_low", "_high"))} for row in rows]


def test_only_pairs_of_the_region_count_and_nothing_else_changes(tmp_path: Path) -> None:
    scene = read_seed(example_path("roundabout"))
    ids, now = scene.track_ids, scene.now
    centre = ids.tolist().index(16)
    inside = set(ids[np.hypot(now.x - now.x[centre], now.y - now.y[centre]) <= AROUND_M].tolist())
    assert 16 in inside and len(inside) < scene.vehicles
    asked: dict[str, Any] = {"models": "rules", "futures": 40, "metrics": ["gap", "wttc_path", "ttc_path"]}
    whole = extrapolate(scene, out=tmp_path / "whole", **asked)
    part = extrapolate(scene, out=tmp_path / "part", region=Region(around=16), **asked)
    assert part.tracks.equals(whole.tracks)
    assert set(part.info["region"]["vehicles"]) == inside and "region" not in whole.info
    for name in ("collisions", "encounters"):
        rows = rows_of(whole, name, inside)
        assert 0 < len(rows) < getattr(whole, name).num_rows
        assert rows_of(part, name, set(ids.tolist())) == rows
    assert (part.values("gap") >= whole.values("gap")).all()
    assert 0 < part.collision.value < whole.collision.value
    assert all({row["track_id"], row["other_id"]} & inside for row in part.worst.to_pylist())
    title = str(summary_table(part).title)
    assert f"only pairs with one of {len(inside)} vehicles within 30 m of 16" in title


def test_a_region_is_checked() -> None:
    scene = read_seed(example_path("roundabout"))
    assert region_of("1010,985,40") == Region(circle=(1010.0, 985.0, 40.0))
    assert region_of("16") == region_of(16) == Region(around=16)
    for text, words in (
        ("1,2", "--region 1,2: needs X,Y,R in m, or a vehicle"),
        ("1,2,-3", "a radius above 0 m"),
    ):
        with pytest.raises(UsageError, match=words):
            region_of(text)
    for both in ({}, {"circle": (0.0, 0.0, 1.0), "around": 16}):
        with pytest.raises(UsageError, match="give a circle or a vehicle"):
            Region(**both)
    with pytest.raises(UsageError, match="--region 999: not in the seed scene; its vehicles: 3"):
        Region(around=999).vehicles(scene)
    with pytest.raises(UsageError, match="no vehicle there at the seed moment"):
        Region(circle=(1e6, 0.0, 5.0)).vehicles(scene)


def test_vehicles_that_cannot_come_near_the_region_are_replayed(monkeypatch: pytest.MonkeyPatch) -> None:
    """On one road: 10 m/s for 3 s and 50 m leave out what is over 30 + 50 m behind one that stands."""
    places, speeds = (0.0, 60.0, 140.0, 400.0), (0.0, 10.0, 10.0, 10.0)
    scene = roads.scene_of(*((x, 0.0, 0.0, v) for x, v in zip(places, speeds, strict=True)))
    road = roads.straight()
    scene = dataclasses.replace(scene, road=road, track_ids=np.array([7, 8, 9, 10]))
    assert Region(circle=(0.0, 0.0, 10.0)).simulated(scene, 30) is scene  # few vehicles
    monkeypatch.setattr("scex_sumo.results.region.ALL_SIMULATED", 3)
    part = Region(circle=(0.0, 0.0, 10.0)).simulated(scene, 30)
    assert part.track_ids.tolist() == [7, 8] and part.notes[-1].startswith("2 of 4 vehicles, too far")
    others = part.obstacles
    assert others is not None and others.ids == ("9", "10") and others.types == ("replayed", "replayed")
    assert others.present.all() and others.states.x[0, 10] == 140.0
    assert others.states.x[0, 10 + 30] == pytest.approx(170.0)  # nothing is recorded: straight on
    assert Region(circle=(0.0, 0.0, 10.0)).simulated(part, 30) is part
    assert Region(circle=(0.0, 0.0, 10.0)).simulated(scene, 30, [10]).track_ids.tolist() == [7, 8, 10]


def test_sumo_drivers_meet_replayed_vehicles_within_reach_only() -> None:
    scene = roads.scene_of((0.0, 0.0, 0.0, 10.0), (200.0, 0.0, 0.0, 10.0), (900.0, 0.0, 0.0, 10.0))
    assert obstacles_in_reach(replaying(scene, [0])) == [0] and obstacles_in_reach(scene) == []
