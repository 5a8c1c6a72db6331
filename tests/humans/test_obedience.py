"""Human-like drivers obey lights and priority, with rare violations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scex_sumo.base.draws import uniforms
from scex_sumo.drivers.registry import build, parse_models
from scex_sumo.humans import attention
from scex_sumo.humans.obedience import RULE_PARAMETERS, manner_of
from scex_sumo.road_rules import Passage, Rules
from scex_sumo.scene import States
from tests.behaviors.roads import Vehicle, closed_loop, scene_of
from tests.rules.test_holds import CROSSROADS, passages, shows

DRAWS = (np.arange(20_000) + 0.5) / 20_000


def test_share_that_runs_red_and_ignores_priority() -> None:
    manner = manner_of(DRAWS, 1.0)
    runs = np.asarray(manner.red_delay_s) > 0
    assert runs.mean() == pytest.approx(RULE_PARAMETERS.runs_red, rel=0.3)
    assert np.isinf(np.asarray(manner.yellow_s)[runs]).all()
    assert 1 - np.asarray(manner.priority).mean() == pytest.approx(RULE_PARAMETERS.ignores, rel=0.6)


def test_a_tenth_stops_at_yellow_2_5_s_before_the_line_and_nobody_drives_3_5_s_before_it() -> None:
    waits = np.asarray(manner_of(DRAWS, 1.0).yellow_s)
    assert np.mean(waits < 2.5) == pytest.approx(0.1, abs=0.02)
    assert np.mean(waits < 3.5) > 1 - 2 * RULE_PARAMETERS.runs_red


def test_drivers_that_respond_late_run_red_no_more_often_than_others() -> None:
    late = uniforms(DRAWS, 2, attention._SALT)
    manner = manner_of(DRAWS, 1.0)
    runs, waits = np.asarray(manner.red_delay_s) > 0, np.asarray(manner.yellow_s)
    unseen = late[:, 1] < 0.01
    assert runs[unseen].mean() < 5 * RULE_PARAMETERS.runs_red
    correlation = np.corrcoef(late[~runs].T, waits[~runs])[:2, 2]
    assert np.abs(correlation).max() < 0.03


def test_the_expected_driver_violates_nothing() -> None:
    manner = manner_of(DRAWS, 0.0)
    assert np.all(manner.priority) and not np.any(manner.red_delay_s)
    assert np.unique(np.asarray(manner.yellow_s)) == pytest.approx([RULE_PARAMETERS.latest_s])


def driven(rules: Rules | None, *vehicles: Vehicle, steps: int = 40, futures: int = 20) -> States:
    """States (C, V, steps) of human-like drivers."""
    scene = replace(scene_of(*vehicles), rules=rules)
    draw = np.random.default_rng(0).random((futures, scene.vehicles))
    model = build(parse_models("likely_driver")[0])
    return closed_loop(model, CROSSROADS, scene, steps=steps, replan=5, futures=futures, draw=draw)


def test_all_stop_at_red_and_nobody_starts() -> None:
    red = Rules(passages=passages(east=0), signals=(shows("r"),))
    x = driven(red, (10.0, 0.0, 0.0, 9.0), futures=200).x[:, 0, -1] + 2.25
    assert (x < 50.3).all()  # those that begin to brake late, too
    standing = driven(red, (46.5, 0.0, 0.0, 0.0)).x[:, 0, -1]
    assert (standing < 48.0).all()


def test_the_first_of_a_queue_starts_soon_at_green() -> None:
    green = Rules(passages=passages(east=0), signals=(shows("G", since_s=0.0),))
    x = driven(green, (46.5, 0.0, 0.0, 0.0)).x[:, 0, -1]
    assert (x > 47.0).mean() >= 0.9


def test_one_that_stands_just_beyond_its_line_waits_for_green() -> None:
    lit = {letter: Rules(passages=passages(east=0), signals=(shows(letter),)) for letter in "rG"}
    red, green = (driven(lit[letter], (49.0, 0.0, 0.0, 0.0)).x[:, 0, -1] for letter in "rG")  # front: 51.25
    assert (red < 49.5).all()
    assert (green > 49.5).mean() >= 0.9


def test_people_start_at_red_and_yellow_as_at_green() -> None:
    ready = Rules(passages=passages(east=0), signals=(shows("u"),))
    assert (driven(ready, (46.5, 0.0, 0.0, 0.0)).x[:, 0, -1] > 47.0).mean() >= 0.9


def test_a_queue_follows_its_leader_at_green_though_it_must_stop_further_on() -> None:
    far = Passage(line=np.array([(90.0, 0.0), (100.0, 0.0)]), lanes=(3,), state="M", signal=1, yields_to=())
    rules = Rules(passages=(*passages(east=0), far), signals=(shows("G"), shows("r")))
    x = driven(rules, (46.5, 0.0, 0.0, 0.0), (40.5, 0.0, 0.0, 0.0)).x[..., -1]
    assert (x[:, 0] > 47.0).mean() >= 0.8
    assert (x[:, 1] > 41.0).mean() >= 0.6


def test_gives_way_in_a_short_gap_only() -> None:
    rules = Rules(passages=passages(yields=True, state="m"))
    near, far = ((60.0, y, np.pi / 2, 10.0) for y in (-20.0, -105.0))
    held, free = (driven(rules, (46.5, 0.0, 0.0, 0.0), other, steps=20).x[:, 0, -1] for other in (near, far))
    assert (held + 2.25 < 57.4).all()  # where the conflict begins
    assert (free > 47.0).mean() > 0.5
