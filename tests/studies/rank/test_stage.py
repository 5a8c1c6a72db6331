"""The two road users of an encounter on the page, in the future that decides."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from scex_sumo.decision.moment import human_part, pairs_of_part
from scex_sumo.extrapolation.job import ruled
from scex_sumo.extrapolation.settings import RunSettings
from scex_sumo.lanelet2sumo.convert import converted
from scex_sumo.scene import HISTORY_STEPS, SeedScene
from scex_sumo.studies.rank.stage import Stage, stage_of_future
from tests.decision.families import behind_standing, person


def stage(scene: SeedScene, folder: Path) -> tuple[Stage, dict[str, object]]:
    assert scene.road is not None
    scene, net = ruled(scene, converted(scene.road, folder / "road.net.xml"), RunSettings())
    part = human_part(scene, net, futures=4)
    row = pairs_of_part(scene, part).to_pylist()[0]
    return stage_of_future(scene, row, part), row


@pytest.mark.parametrize(
    "scene", [behind_standing(20.0, 20.0), person(10.0, 0.6)], ids=["vehicles", "person"]
)
def test_both_move_until_a_second_after_they_touch(scene: SeedScene, tmp_path: Path) -> None:
    shown, row = stage(scene, tmp_path)
    other, own = (np.array(outline) for outline in shown.outlines[-2:])
    assert len(other) == len(own) == shown.contact + 1
    apart = np.hypot(*(other - own)[:, :2].T)
    assert apart.min() < 5.0 < apart[0]
    assert shown.picture.count("<rect") == len(shown.outlines)
    conflict_s = row["conflict_s"]
    assert isinstance(conflict_s, float) and shown.contact >= 10 * conflict_s


def test_the_picture_encloses_the_last_3_s_of_both(tmp_path: Path) -> None:
    shown, _ = stage(behind_standing(30.0, 45.0), tmp_path)
    other, own = (np.array(outline) for outline in shown.outlines[-2:])
    left, top, width, height = map(float, str(shown.picture).split('viewBox="')[1].split('"')[0].split())
    for x, y, _ in (*other, *own):
        assert left < x < left + width and top < -y < top + height
    assert len(own) <= HISTORY_STEPS + 1 + 30
