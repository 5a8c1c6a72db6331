"""The two vehicles of an encounter on the page, or a vehicle and a person, until they touch."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from scex_sumo.scene import HISTORY_STEPS, Obstacles, SeedScene, States
from scex_sumo.studies.moments.pairs import pairs_of_moment
from scex_sumo.studies.rank.stage import stage_of
from tests.queues import queues


def with_person() -> SeedScene:
    """One vehicle, and a pedestrian 3 m beside its way."""
    still = np.ones((1, HISTORY_STEPS + 1))
    person = Obstacles(
        ids=("P7",),
        types=("pedestrian",),
        length=np.array([0.6]),
        width=np.array([0.6]),
        states=States(x=30 * still, y=3 * still, heading=0 * still, speed=0 * still),
        present=still > 0,
    )
    return dataclasses.replace(queues(1, gap_m=5.0), obstacles=person)


@pytest.mark.parametrize(
    ("scene", "later"), [(queues(2, gap_m=5.0), 0), (with_person(), 5)], ids=["vehicles", "person"]
)
def test_both_move_until_they_touch(scene: SeedScene, later: int) -> None:
    """``later``: steps until the vehicle is in the picture."""
    row = pairs_of_moment(scene).to_pylist()[0]
    stage = stage_of(scene, row)
    acts, responds = (np.array(outline) for outline in stage.outlines[-2:])
    assert len(acts) == len(responds) == stage.contact + 1
    assert np.isclose(later + stage.contact - HISTORY_STEPS, 10 * row["contact_s"], atol=1)
    apart = np.hypot(*(acts - responds)[:, :2].T)
    assert apart[-1] < apart[0] and apart[-1] < 5.0
    assert stage.picture.count("<rect") == len(stage.outlines)


def test_the_picture_shows_the_last_2_s_of_fast_vehicles_and_not_all_their_way() -> None:
    scene = queues(2, gap_m=25.0, speed=30.0)
    row = pairs_of_moment(scene).to_pylist()[0]
    stage = stage_of(scene, row)
    acts, responds = (np.array(outline) for outline in stage.outlines[-2:])
    left, top, width, height = map(float, str(stage.picture).split('viewBox="')[1].split('"')[0].split())
    assert width == pytest.approx(np.ptp([acts[-21:, 0], responds[-21:, 0]]) + 20.0, abs=0.1)
    assert 21 <= len(acts) < HISTORY_STEPS + 1 + 10 * row["contact_s"]
    for x, y, _ in (*acts, *responds):
        assert left < x < left + width and top < -y < top + height
