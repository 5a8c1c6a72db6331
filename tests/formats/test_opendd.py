"""openDD: tables of SQLite files as published become recordings and a road in local metres."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from scex_sumo import find_recordings, load_recording, read_seed
from scex_sumo.lanelet2sumo.convert import convert
from tests.formats import streets
from tests.lanelet2sumo.judge.report import check_net
from tests.runs import extrapolate

EAST_M, NORTH_M = 619_300.0, 5_809_100.0
COLUMNS = {
    "TIMESTAMP": "REAL",
    "OBJID": "INTEGER",
    "UTM_X": "REAL",
    "UTM_Y": "REAL",
    "UTM_ANGLE": "REAL",
    "V": "REAL",
    "CLASS": "TEXT",
    "WIDTH": "REAL",
    "LENGTH": "REAL",
}


def write(path: Path, table: str, columns: dict[str, str], rows: list[tuple[object, ...]]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with closing(sqlite3.connect(path)) as file, file:
        file.execute(
            f"CREATE TABLE {table} ({', '.join(f'{name} {kind}' for name, kind in columns.items())})"
        )
        file.executemany(f"INSERT INTO {table} VALUES ({', '.join('?' * len(columns))})", rows)


def write_map(path: Path, columns: dict[str, str] | None = None) -> None:
    rows: list[tuple[object, ...]] = []
    for i, after in streets.SUCCESSORS.items():
        line = ", ".join(f"{x} {y}" for x, y in streets.centre(i, EAST_M, NORTH_M))
        following = str([float(j) for j in after]) if after else None
        rows.append((i, "trafficLane", f"LINESTRING ({line})", following))
    rows += [(None, "boundary", f"LINESTRING ({EAST_M} {NORTH_M}, {EAST_M + 9} {NORTH_M})", None)]
    rows += [(None, "area", "POLYGON ((0 0, 1 0, 1 1, 0 0))", None)]
    kinds = columns or {"id": "REAL", "type": "TEXT", "geometry": "TEXT", "successors": "TEXT"}
    write(path, "rdb1", kinds, [row[: len(kinds)] for row in rows])


@pytest.fixture
def place(tmp_path: Path) -> Path:
    """The folder of a roundabout as published, with two recordings."""
    return write_place(tmp_path)


def write_place(above: Path) -> Path:
    folder = above / "opendd_v3-rdb1"
    write_map(folder / "rdb1/map_rdb1/map_rdb1.sqlite")
    kinds = {"car": "Car", "pedestrian": "Pedestrian"}
    users = [(k, *user[1:]) for k, user in enumerate(streets.USERS) if user[0] not in ("14", "16")]
    rows = [
        (float(t), k, x + EAST_M, y + NORTH_M, 0.0, speed, kinds[kind], 1.9, 4.4)
        for k, kind, start, y, speed in users
        for t, x in zip(streets.TIMES, streets.driven(start, speed), strict=True)
    ]
    for table in ("rdb1_2", "rdb1_10"):
        write(folder / "trajectories_rdb1_v3.sqlite", table, COLUMNS, rows)
    return folder


def test_each_table_of_a_folder_is_a_recording_with_its_map(place: Path) -> None:
    found = find_recordings([place.parent])
    assert sorted(one.name for one in found) == ["rdb1_10", "rdb1_2"]
    assert {one.dataset for one in found} == {"opendd"} and {one.site for one in found} == {"rdb1"}
    loaded = load_recording(found[0])
    assert loaded.road.lanes[1].successors == (3, 5) and loaded.road.lanes[1].left == 2
    frame = loaded.road.georeference
    assert frame is not None and (frame.east_m, frame.north_m) == (619_000.0, 5_809_000.0)
    assert "+zone=32" in frame.projection
    report = check_net(convert(loaded.road, place / "x.net.xml").path, loaded.road)
    assert not report.problems() and report["deviation_max_m"] <= 0.1
    assert loaded.table.vehicles.labels == ("0", "1", "2") and set(loaded.table.vehicles.length) == {4.4}
    np.testing.assert_allclose(loaded.table.vehicles.y.min(), 100.0, atol=0.1)


def test_a_recording_runs_to_its_futures(place: Path, tmp_path: Path) -> None:
    map_path = place / "rdb1/map_rdb1/map_rdb1.sqlite"
    scene = read_seed(map_path, tracks=place / "trajectories_rdb1_v3.sqlite/rdb1_10", time=2.0)
    assert scene.vehicles == 3 and scene.obstacles is not None and scene.obstacles.types == ("pedestrian",)
    assert read_seed(map_path, time=2.0).vehicles == 3  # the first table
    assert extrapolate(scene, futures=2, out=tmp_path / "out", steps=10).futures == 2
