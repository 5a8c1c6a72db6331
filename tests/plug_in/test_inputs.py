"""What a predictor is given, from scenes that one can do by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scex_sumo.plug_in.inputs import ARRAYS, Surroundings, predictor_inputs
from tests.behaviors import roads
from tests.seeds import people_of, steady

# One looks along +y at (10, 20); a second is 6 m ahead of it and crosses to the right; a third is 80 m off.
SCENE = roads.scene_of((10.0, 20.0, np.pi / 2, 4.0), (10.0, 26.0, 0.0, 3.0), (90.0, 20.0, 0.0, 3.0))


def given(*names: str, **how: float) -> dict[str, np.ndarray]:
    history = roads.present(SCENE, 2)
    surroundings = Surroundings(**how)  # type: ignore[arg-type]
    return predictor_inputs(history, roads.straight(), roads.every(history), surroundings, names or ARRAYS)


def test_the_own_history_ends_at_the_origin_with_the_heading_ahead() -> None:
    history = given("history")["history"]
    assert history.shape == (6, 11, 5)
    assert history[:, -1, :4] == pytest.approx(np.tile([0.0, 0.0, 1.0, 0.0], (6, 1)))
    # A second ago it was 4 m behind, whatever its heading on the map.
    assert history[0, 0] == pytest.approx([-4.0, 0.0, 1.0, 0.0, 4.0])


def test_neighbours_are_in_the_own_frame_nearest_first_and_masked_beyond_the_radius() -> None:
    arrays = given(neighbours=3, radius=50.0)
    assert arrays["neighbours"].shape == (6, 3, 11, 5)
    assert arrays["neighbour_mask"].tolist()[:3] == [[True, False, False]] * 2 + [[False] * 3]
    # 6 m ahead, turned to the right, so that its heading is -90 degrees in the first one's frame.
    assert arrays["neighbours"][0, 0, -1] == pytest.approx([6.0, 0.0, 0.0, -1.0, 3.0])
    # A second ago it was 3 m further left.
    assert arrays["neighbours"][0, 0, 0, :2] == pytest.approx([6.0, 3.0])
    assert not arrays["neighbours"][0, 1:].any()
    assert arrays["neighbour_size"][0].tolist() == [[4.5, 1.8], [0.0, 0.0], [0.0, 0.0]]
    wide = given("neighbours", "neighbour_mask", neighbours=2, radius=100.0)
    assert wide["neighbour_mask"].all()
    assert wide["neighbours"][0, 1, -1, :2] == pytest.approx([0.0, -80.0])


def test_kinds_are_those_of_any_data_set() -> None:
    types = ("vehicle", "truck_bus", "motorcyclist", "bike", "person", "tram")
    history = roads.present(replace(SCENE, types=types[:3]))
    people = people_of(steady(*[(10.0, 23.0, 0.0, 1.0)] * 3), *types[3:])
    history = replace(history, scene=replace(history.scene, obstacles=people))
    seen = predictor_inputs(history, roads.straight(), roads.every(history), Surroundings(neighbours=4))
    assert seen["kind"][:3].tolist() == [0, 1, 2]
    assert sorted(seen["neighbour_kind"][0].tolist()) == [1, 3, 4, 5]


def test_obstacles_of_an_unknown_type_are_other() -> None:
    types = ("animal", "construction", "parked")
    people = people_of(steady(*[(10.0, 23.0, 0.0, 0.0)] * 3), *types)
    history = roads.present(replace(SCENE, obstacles=people))
    seen = predictor_inputs(history, roads.straight(), roads.every(history), Surroundings(neighbours=4))
    assert sorted(seen["neighbour_kind"][0].tolist()) == [0, 0, 5, 5]


def test_pedestrians_are_neighbours_with_their_own_past() -> None:
    walk = steady((10.0, 23.0, np.pi / 2, 1.0), time_s=0.1 * np.arange(14))
    walked = people_of(walk, length=0.5, present=np.array([[True] * 13 + [False]]))
    history = roads.present(replace(SCENE, obstacles=walked))
    vehicles = roads.every(history)

    def seen(step: int) -> dict[str, np.ndarray]:
        return predictor_inputs(
            replace(history, step=step), roads.straight(), vehicles, Surroundings(neighbours=3)
        )

    now, later, gone = seen(0), seen(2), seen(3)
    # At y = 24 now, 4 m ahead of the first vehicle, which is nearer than the vehicle 6 m ahead.
    assert now["neighbours"][0, 0, -1, :2] == pytest.approx([4.0, 0.0])
    assert now["neighbours"][0, 0, 0, 0] == pytest.approx(3.0)
    assert now["neighbour_kind"][0].tolist() == [4, 0, 0]
    assert later["neighbours"][0, 0, -1, 0] == pytest.approx(4.2)
    assert gone["neighbour_kind"][0].tolist() == [0, 0, 0]
