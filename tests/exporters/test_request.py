from __future__ import annotations

import copy
import shutil
from pathlib import Path

import numpy as np
import pytest
from pyarrow import csv

from scex_sumo.base.errors import ResultError, UsageError
from scex_sumo.converters.datasets.cases import marked_vehicles
from scex_sumo.exporters.request import EXPORTERS, Request
from scex_sumo.results.run import Run, open_run
from scex_sumo.scenarios import example_path
from scex_sumo.scenarios.seeds import read_seed
from tests.runs import extrapolate


def test_six_futures_are_the_modalities_of_an_interpret_case(run: Run, tmp_path: Path) -> None:
    futures = (3, 0, 1, 2)
    (file,) = EXPORTERS.load("interpret")(Request(run=run, futures=futures, out=tmp_path / "x_sub.csv"))
    rows = csv.read_csv(file).to_pandas()
    assert len(rows) == 30 * run.scene.vehicles and list(rows.columns[-3:]) == ["x4", "y4", "psi_rad4"]
    track = run.scene.track_ids[1]
    mine = rows[rows["track_id"] == track]
    assert mine["frame_id"].tolist() == list(range(11, 41)) and (mine["timestamp_ms"] % 100 == 0).all()
    for number, future in enumerate(futures, start=1):
        states = run.states(future)[1, 10:40]
        assert np.array_equal(mine[f"x{number}"], states.x)
        assert np.array_equal(mine[f"psi_rad{number}"], states.heading)


def of_case(run: Run, case: str, tracks: Path) -> Run:
    """Return the run as that of a case of the challenge's input."""
    other = copy.copy(run)
    source = {"kind": "tracks", "tracks": str(tracks), "case": case, **marked_vehicles(tracks, case)}
    other.info = {**run.info, "seed_scene": {**run.info["seed_scene"], "source": source, "location": "DR_X"}}
    return other


def marked(path: Path, *rows: str) -> Path:
    """Write which vehicles are predicted, as the challenge's input does, and return the file."""
    path.write_text("\n".join(["case_id,track_id,frame_id,track_to_predict,interesting_agent", *rows]) + "\n")
    return path


def test_a_submission_has_the_marked_vehicles_of_all_cases(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    one, two = run.scene.track_ids[:2].tolist()
    marks = f"3.0,{one},1,1,0", f"3.0,{two},1,1,1", f"4.0,{one},1,1,0", "4.0,P1,1,0,0"
    tracks = marked(tmp_path / "DR_X_obs.csv", *marks)
    write = EXPORTERS.load("interpret")
    for case in ("3.0", "4.0", "3.0"):  # the third replaces the first
        (file,) = write(Request(run=of_case(run, case, tracks), futures=(0, 1)))
    assert file == Path("DR_X_sub.csv")
    rows = csv.read_csv(file).to_pandas()
    assert set(zip(rows["case_id"], rows["track_id"], rows["interesting_agent"], strict=True)) == {
        (3.0, one, 0),
        (3.0, two, 1),
        (4.0, one, 0),
    }
    assert len(rows) == 90 and (rows["track_to_predict"] == 1).all()
    with pytest.raises(UsageError, match="has other columns"):
        write(Request(run=of_case(run, "4.0", tracks), futures=(0,)))
    marked(tracks, "3.0,999,1,1,0")
    with pytest.raises(ResultError, match="vehicle 999 is to be predicted"):
        write(Request(run=of_case(run, "3.0", tracks), futures=(0, 1)))


def test_a_result_folder_has_all_that_exports_need(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Map and tracks are gone, and the folder is at another place."""
    (tmp_path / "data").mkdir()
    for suffix in (".osm", ".csv"):
        shutil.copy(example_path("roundabout").with_suffix(suffix), tmp_path / "data")
    monkeypatch.chdir(tmp_path)
    scene = read_seed("data/roundabout.osm")
    made = extrapolate(scene, futures=1, models="constant_velocity", steps=30, out="out")
    assert scene.road is not None and made.road.lanes.keys() == scene.road.lanes.keys()
    shutil.rmtree("data")
    moved = open_run(Path("out").rename("moved"))
    for name in ("openscenario", "commonroad", "scenarionet", "osi", "interpret", "sumo"):
        assert EXPORTERS.load(name)(Request(run=moved, futures=(0,), out=tmp_path / name))
