"""Unknown lights are inferred from who stands and who drives."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from scex_sumo.behaviors.driving.paths import seed_paths
from scex_sumo.road_rules import Rules, Signal
from scex_sumo.rules.inferred import drawn_lights, expected_lights
from scex_sumo.scene import SceneHistory
from tests.behaviors.roads import Vehicle, present, scene_of
from tests.rules.test_holds import CROSSROADS, passages

RULES = Rules(passages=passages(east=0, north=1, yields=True), signals=(Signal(), Signal()))
STANDS, DRIVES, AWAY = (46.5, 0.0, 0.0, 0.0), (60.0, -8.0, np.pi / 2, 10.0), (-20.0, 0.0, 0.0, 10.0)


def history_of(*vehicles: Vehicle, futures: int = 400) -> SceneHistory:
    return present(replace(scene_of(*vehicles), rules=RULES), futures)


def lit(history: SceneHistory, change_s: float = 1000.0):
    shape = (len(history.futures), 2)
    noise = np.random.default_rng(0).logistic(size=shape)
    paths = seed_paths(history.scene, CROSSROADS)
    return drawn_lights(history, paths, RULES, noise, np.full(shape, change_s))


def test_one_that_drives_has_green_and_one_that_stands_red() -> None:
    history = history_of(STANDS, DRIVES)
    expected = expected_lights(history, seed_paths(history.scene, CROSSROADS), RULES)
    assert expected.red[0].tolist() == [True, False, False]
    assert expected.green[0].tolist() == [False, True, False]
    drawn = lit(history)
    assert drawn.red[:, 0].mean() > 0.95 and drawn.green[:, 1].mean() > 0.95


def test_conflicting_groups_are_never_green_together_and_one_without_evidence_is_open() -> None:
    drawn = lit(history_of(AWAY))
    assert not (drawn.green[:, 0] & drawn.green[:, 1]).any()
    assert 0.2 < drawn.green[:, 0].mean() < 0.8
    history = history_of(AWAY)
    expected = expected_lights(history, seed_paths(history.scene, CROSSROADS), RULES)
    assert not expected.red.any()


def test_the_other_groups_become_green_after_yellow_and_red() -> None:
    history = history_of(STANDS, DRIVES)
    yellow, cleared, changed = (lit(replace(history, step=step), change_s=6.0) for step in (20, 50, 61))
    assert yellow.yellow[:, 1].mean() > 0.9
    assert (cleared.red[:, 0] & cleared.red[:, 1]).mean() > 0.9
    assert changed.green[:, 0].mean() > 0.9 and changed.red[:, 1].mean() > 0.9
