"""Recordings from a car: what parks beside the lanes is an obstacle, what is off the map is cut and named."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from scex_sumo.converters.tracks.rows import TrackRows, TrackTable
from scex_sumo.formats.samples.build import track_rows
from scex_sumo.formats.samples.from_car import within_map
from scex_sumo.road import Road
from tests.seeds import lane_along

ROAD = Road(name="street", lanes={1: lane_along(1, [(0, 0), (100, 0)], width=4.0)})


def rows_of(*tracks: tuple[str, np.ndarray, np.ndarray]) -> TrackRows:  # type: ignore[type-arg]
    count = len(tracks[0][1])
    track, zeros = np.repeat(np.arange(len(tracks)), count), np.zeros(len(tracks) * count)
    return track_rows(
        track,
        [label for label, *_ in tracks],
        ["car"] * len(tracks),
        timestamp_ms=100.0 * np.tile(np.arange(count), len(tracks)),
        x=np.concatenate([x for _, x, _ in tracks]),
        y=np.concatenate([y for _, _, y in tracks]),
        vx=zeros + 1.0,
        vy=zeros,
        psi_rad=zeros,
        length=zeros + 4.5,
        width=zeros + 1.8,
    )


def table_of(rows: TrackRows) -> TrackTable:
    none = rows.take(np.zeros(len(rows), bool))
    return TrackTable(path=Path("x"), cases=("",), vehicles=rows, others=none, step_s=0.1)


def test_parked_vehicles_are_obstacles_and_those_that_wait_in_the_lane_are_not() -> None:
    still, jitter = np.full(40, 50.0), np.tile([0.0, 0.2], 20)
    rows = rows_of(
        ("1", np.linspace(0.0, 80.0, 40), np.zeros(40)),  # drives
        ("2", still - 20.0, np.full(40, 0.3)),  # waits in the lane
        ("3", still, np.full(40, -1.6) + jitter),  # at the kerb, its box jitters
        ("4", still + 20.0, np.full(40, -5.0)),  # beside
        ("5", np.linspace(60.0, 66.0, 40), np.full(40, -4.0)),  # leaves a parking lot
    )
    table, notes = within_map(table_of(rows), ROAD)
    assert table.vehicles.labels == ("1", "2", "5")
    assert table.others.labels == ("3", "4") and set(table.others.types) == {"parked"}
    assert notes == ["2 vehicles that never move stand beside the lanes: parked, taken for obstacles"]
