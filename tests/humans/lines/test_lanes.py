"""Lane changes of the likely driver: as its motion across the lane tells, and less where somebody drives."""

from __future__ import annotations

import numpy as np
import pytest

from scex_sumo.humans.lines.lanes import change_features, change_offsets, lanes_occupied
from scex_sumo.humans.parameters import human_parameters
from tests.behaviors import roads

HUMAN = human_parameters()
FREE = np.zeros((1, 2), dtype=bool)
LANES = np.array([[3.0, 3.0]])


def score(offset_m: float, speed_mps: float, *, taken: bool = False, scatter: float = 0.0) -> np.ndarray:
    across = np.array([[offset_m, speed_mps, 0.0]])
    features = change_features(across, LANES, FREE | taken, np.array([scatter]), HUMAN)
    return np.asarray(features[0] @ HUMAN.change_weights)


def test_who_drifts_to_a_side_changes_to_it_and_the_sides_are_alike() -> None:
    left, right = score(0.6, 0.8)
    assert left > 0.0 > right
    assert score(-0.6, -0.8) == pytest.approx([right, left])
    assert score(0.0, 0.0).max() < -3.5  # who keeps its lane: two in a hundred, or fewer


def test_motion_of_boxes_that_jitter_is_believed_less_and_a_taken_lane_is_less_inviting() -> None:
    assert score(0.6, 0.8, scatter=0.7)[0] < score(0.6, 0.8)[0] - 2.0
    assert score(0.6, 0.8, taken=True)[0] < score(0.6, 0.8)[0]


def test_who_changes_is_near_the_middle_of_the_next_lane_after_three_seconds() -> None:
    across = np.array([[1.0, 0.7, 0.0]])
    left, right = change_offsets(across, LANES, HUMAN)[0]
    assert left == pytest.approx(2.6, abs=0.3)
    assert right < 0.0
    assert change_offsets(across, np.full((1, 2), np.inf), HUMAN)[0, 0] == pytest.approx(left, abs=0.3)


def test_a_lane_is_taken_by_who_is_there_or_soon_will_be() -> None:
    beside = roads.scene_of((100.0, 0.0, 0.0, 10.0), (100.0, 3.5, 0.0, 10.0))
    behind = roads.scene_of((100.0, 0.0, 0.0, 10.0), (88.0, 3.5, 0.0, 15.0))
    away = roads.scene_of((100.0, 0.0, 0.0, 10.0), (88.0, 3.5, 0.0, 10.0))
    assert [lanes_occupied(scene, HUMAN)[0].tolist() for scene in (beside, behind, away)] == [
        [True, False],
        [True, False],
        [False, False],
    ]
