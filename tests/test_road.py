"""The road as data."""

from __future__ import annotations

import dataclasses

import pytest

from scex_sumo.road import Lane, Regulation, Road
from tests.seeds import lane_along


def lane(lane_id: int, **fields: object) -> Lane:
    return lane_along(lane_id, [(0, 0), (1, 0)], **fields)


def test_only_lanes_for_cars_are_vehicle_lanes() -> None:
    kinds = {1: "vehicle", 2: "bus", 3: "bicycle", 4: "pedestrian", 5: "other", 6: "vehicle"}
    road = Road(name="drawn", lanes={i: lane(i, kind=kind) for i, kind in kinds.items()})
    assert list(road.vehicle_lanes) == [1, 6]


def test_a_lane_by_itself_is_a_vehicle_lane_without_neighbours() -> None:
    alone = lane(1)
    assert alone.kind == "vehicle"
    assert (alone.successors, alone.conflicts) == ((), ())
    assert (alone.left, alone.adjacent_left, alone.reverse_of) == (None, None, None)


@pytest.mark.parametrize(
    "part", [lane(1), Regulation(element_id=1, kind="stop"), Road(name="drawn", lanes={})]
)
def test_parts_of_a_road_cannot_be_changed(part: object) -> None:
    field = dataclasses.fields(part)[0].name  # type: ignore[arg-type]
    with pytest.raises(dataclasses.FrozenInstanceError):
        setattr(part, field, 2)
