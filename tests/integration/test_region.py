"""Region of a scene: pairs of its vehicles count, and all vehicles are simulated."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from scex_sumo.base.errors import UsageError
from scex_sumo.page.encounter_table import print_encounters
from scex_sumo.reports.run_table import summary_table
from scex_sumo.results.region import AROUND_M, Region, parse_region
from scex_sumo.results.run import Run
from scex_sumo.scenarios import example_path
from scex_sumo.scenarios.seeds import read_seed
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
    asked: dict[str, Any] = {
        "models": "rules",
        "futures": 40,
        "exact": False,
        "metrics": ["gap", "wttc_path", "ttc_path"],
    }
    whole = extrapolate(scene, out=tmp_path / "whole", **asked)
    part = extrapolate(scene, out=tmp_path / "part", region=Region(around=16), **asked)
    assert part.tracks.equals(whole.tracks)
    assert set(part.info["region"]["vehicles"]) == inside and "region" not in whole.info
    for name in ("collisions", "encounters"):
        rows = rows_of(whole, name, inside)
        assert 0 < len(rows) < getattr(whole, name).num_rows
        assert rows_of(part, name, set(ids.tolist())) == rows
    assert (part.values("gap") >= whole.values("gap")).all()
    assert 0 < part.collision.sampled.value < whole.collision.sampled.value
    assert all({row["track_id"], row["other_id"]} & inside for row in part.worst.to_pylist())
    title = str(summary_table(part).title)
    assert f"only pairs with one of {len(inside)} vehicles within 30 m of 16" in title
    console = Console(file=io.StringIO(), width=120)
    print_encounters(whole, console, most=3, region=Region(around=16))
    assert isinstance(console.file, io.StringIO)
    said = console.file.getvalue()
    assert f"one of them collides in {part.collision.percent} of the futures" in said
    assert f"{part.encounters.num_rows} pairs of vehicles meet" in said


def test_a_region_is_checked() -> None:
    scene = read_seed(example_path("roundabout"))
    assert parse_region("1010,985,40", None) == Region(circle=(1010.0, 985.0, 40.0))
    assert parse_region(None, None).vehicles(scene) is None
    for text, around, words in (
        ("1,2", None, "--region 1,2: needs X,Y,R in m"),
        ("1,2,-3", None, "a radius above 0 m"),
        ("1,2,3", 16, "exclude one another"),
    ):
        with pytest.raises(UsageError, match=words):
            parse_region(text, around)
    with pytest.raises(UsageError, match="--around 999: not in the seed scene; its vehicles: 3"):
        Region(around=999).vehicles(scene)
    with pytest.raises(UsageError, match="no vehicle there at the seed moment"):
        Region(circle=(1e6, 0.0, 5.0)).vehicles(scene)
