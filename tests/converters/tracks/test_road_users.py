from __future__ import annotations

import pytest

from scex_sumo.converters.tracks.road_users import MOTOR_TYPES, OTHER_TYPES, road_user
from scex_sumo.world.vehicle_types import gui_shape

TAKEN = {"bike": "bicycle", "cyclist": "bicycle", "pedestrian/bicycle": "bicycle", "person": "pedestrian"}
TAKEN |= {"motorbike": "motorcycle", "lorry": "truck", "truck_bus": "bus", "taxi": "car", "unheard of": "car"}


@pytest.mark.parametrize("kind", TAKEN)
def test_recorded_types_are_taken_for_road_users_that_other_programs_know(kind: str) -> None:
    assert road_user(kind) == TAKEN[kind]


def test_no_motor_vehicle_is_taken_for_somebody_without_a_motor() -> None:
    assert not {road_user(kind) for kind in MOTOR_TYPES} & {"bicycle", "pedestrian"}
    assert {road_user(kind) for kind in OTHER_TYPES - {"animal", "parked", "replayed"}} == {
        "bicycle",
        "pedestrian",
        "tram",
    }
    assert gui_shape("bike") == "bicycle"
