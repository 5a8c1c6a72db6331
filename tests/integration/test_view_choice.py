"""``view`` frames what is worth a look: encounters, the most different futures."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from scex_sumo import example_path, read_seed
from scex_sumo.base.errors import UsageError
from scex_sumo.results.run import Run
from scex_sumo.views.futures import most_different, write_encounter, write_grid
from tests.runs import extrapolate


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    out = tmp_path_factory.mktemp("view") / "out"
    return extrapolate(read_seed(example_path("roundabout")), futures=24, out=out)


def stops_at(file: Path) -> float:
    view = ElementTree.parse(file.with_suffix(".view.xml")).getroot()
    return float(view.find("breakpoint").get("time"))  # type: ignore[union-attr, arg-type]


def rings(file: Path) -> set[str]:
    drawn = ElementTree.parse(file.with_suffix(".add.xml")).getroot()
    return {poly.get("id", "") for poly in drawn.iter("poly") if poly.get("id", "").startswith("ring.")}


def test_an_encounter_stops_where_the_two_meet(run: Run) -> None:
    row = run.encounters.to_pylist()[0]
    file = write_encounter(run, row["other_id"], row["track_id"])
    assert file.name == f"future_{row['future']:04d}.sumocfg"
    assert stops_at(file) == pytest.approx(1.0 + row["time_s"], abs=0.051)
    ids = run.info["seed_scene"]["track_ids"]
    assert rings(file) == {f"ring.{ids.index(row[name])}" for name in ("track_id", "other_id")}
    with pytest.raises(UsageError, match="3, 3: these two vehicles meet in no future"):
        write_encounter(run, 3, 3)


def test_a_grid_shows_futures_that_differ_most(run: Run) -> None:
    chosen = most_different(run, 9)
    assert len(set(chosen.tolist())) == 9
    ends = np.array([[run.states(c).x[:, -1], run.states(c).y[:, -1]] for c in range(run.futures)])
    apart = np.linalg.norm(ends[chosen][:, None] - ends[chosen][None], axis=(2, 3))
    every = np.linalg.norm(ends[:, None] - ends[None], axis=(2, 3))
    assert apart[np.triu_indices(9, 1)].min() > np.median(every[np.triu_indices(run.futures, 1)]) / 2
    with pytest.raises(UsageError, match="--grid 1: give 2 to 24"):
        write_grid(run, 1)


def test_a_grid_is_cropped_to_its_vehicles_and_fills_the_window(run: Run) -> None:
    file = write_grid(run, 9)
    lanes = ElementTree.parse(file.with_suffix(".cropped.net.xml")).getroot().iter("lane")
    points = np.array([p.split(",")[:2] for lane in lanes for p in lane.get("shape", "").split()], float)
    where = np.stack([np.asarray(run.tracks[name]) for name in ("x", "y")], axis=1)
    low, high = where.min(axis=0) - 15.01, where.max(axis=0) + 15.01
    assert low[1] <= points[:, 1].min() and points[:, 1].max() <= high[1]
    # 5 columns, 2 rows: tiles are wider than needed, so that the grid is 1.6 times as wide as high.
    wide, tall = high - low + 12.0
    more = 1.6 * 2 / 5 * tall - wide
    assert more > 0
    assert low[0] - more / 2 - 0.01 <= points[:, 0].min() < low[0]
    assert points[:, 0].max() <= high[0] + more / 2 + 0.01
