from __future__ import annotations

import pytest

from scex_sumo.converters.tracks.road_users import road_user

TAKEN = {"bike": "bicycle", "cyclist": "bicycle", "pedestrian/bicycle": "bicycle", "person": "pedestrian"}
TAKEN |= {"motorbike": "motorcycle", "lorry": "truck", "truck_bus": "bus", "taxi": "car", "unheard of": "car"}


@pytest.mark.parametrize("kind", TAKEN)
def test_recorded_types_are_taken_for_road_users_that_other_programs_know(kind: str) -> None:
    assert road_user(kind) == TAKEN[kind]
