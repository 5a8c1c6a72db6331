"""Drivers obey lights, priority and crosswalks; each violation is the standard driver but for one thing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scex_sumo.drivers.registry import build, parse_models
from scex_sumo.road_rules import Passage, Rules, Signal
from scex_sumo.rules.holds import precedence
from scex_sumo.scene import Obstacles, SeedScene
from tests.behaviors.roads import Vehicle, closed_loop, lane, road, scene_of
from tests.seeds import people_of, steady

# Lanes 1, 2, 3 along +x with the junction from 50 to 70 m; 11, 12, 13 along +y at x = 60.
CROSSROADS = road(
    lane(1, [(-50, 0), (50, 0)], successors=(2,)),
    lane(2, [(50, 0), (70, 0)], predecessors=(1,), successors=(3,)),
    lane(3, [(70, 0), (250, 0)], predecessors=(2,)),
    lane(11, [(60, -110), (60, -10)], successors=(12,)),
    lane(12, [(60, -10), (60, 10)], predecessors=(11,), successors=(13,)),
    lane(13, [(60, 10), (60, 200)], predecessors=(12,)),
)
EAST, NORTH = np.array([(50.0, 0.0), (70.0, 0.0)]), np.array([(60.0, -10.0), (60.0, 10.0)])


def passages(
    *, east: int = -1, north: int = -1, yields: bool = False, state: str = "M"
) -> tuple[Passage, Passage]:
    return (
        Passage(line=EAST, lanes=(1, 2, 3), state=state, signal=east, yields_to=(1,) if yields else ()),
        Passage(line=NORTH, lanes=(11, 12, 13), state="M", signal=north, yields_to=()),
    )


def shows(letter: str, *, since_s: float = 10.0) -> Signal:
    """A light that shows one letter from `since_s` before the seed moment to 90 s after it."""
    return Signal(letters="x" + letter, ends_s=np.array([10.0, 110.0]), start_s=10.0 + since_s)


def front(models: str, rules: Rules, *vehicles: Vehicle, steps: int = 60, obstacles: Obstacles | None = None):
    """x of the first vehicle's front after each step, and whether vehicles are driven by the model."""
    scene: SeedScene = replace(scene_of(*vehicles, obstacles=obstacles), rules=rules)
    model = build(parse_models(models)[0])
    driven = closed_loop(model, CROSSROADS, scene, steps=steps, replan=5)
    return driven.x[0, 0] + 2.25


FAR, NEAR = (0.0, 0.0, 0.0, 10.0), (40.0, 0.0, 0.0, 12.0)


def test_standard_driver_stops_at_red_and_drives_at_green() -> None:
    lit = {letter: Rules(passages=passages(east=0), signals=(shows(letter),)) for letter in "rG"}
    red, green = (front("standard_driver", lit[letter], FAR, steps=100) for letter in "rG")
    assert 45.0 < red[-1] < 50.0
    assert green[-1] > 70.0


@pytest.mark.parametrize(
    ("models", "stops"), [("standard_driver", True), ("risky_driver", False), ("runs_red", False)]
)
def test_at_yellow_who_can_brake_comfortably_stops(models: str, stops: bool) -> None:
    rules = Rules(passages=passages(east=0), signals=(shows("y"),))
    assert (front(models, rules, FAR)[-1] < 50.0) == stops


def test_risky_driver_drives_into_early_red_only() -> None:
    early, late = (
        Rules(passages=passages(east=0), signals=(shows("r", since_s=since),)) for since in (0.1, 5.0)
    )
    assert front("risky_driver", early, (42.0, 0.0, 0.0, 10.0), steps=20)[-1] > 55.0
    assert front("risky_driver", late, (30.0, 0.0, 0.0, 8.0))[-1] < 50.5


@pytest.mark.parametrize(
    ("models", "before_line"), [("standard_driver", True), ("ignores_priority", False), ("runs_red", True)]
)
def test_gives_way_to_one_with_priority(models: str, before_line: bool) -> None:
    rules = Rules(passages=passages(yields=True))
    other = (60.0, -35.0, np.pi / 2, 10.0)  # reaches the conflict 3.2 s later
    x = front(models, rules, (25.0, 0.0, 0.0, 8.0), other, steps=30)
    assert (x[-1] < 50.0) == before_line


def test_goes_before_one_that_is_far_away_or_has_red() -> None:
    far = (60.0, -100.0, np.pi / 2, 8.0)
    near = (60.0, -35.0, np.pi / 2, 10.0)
    own, alone = (30.0, 0.0, 0.0, 8.0), Rules(passages=passages())
    free = front("standard_driver", alone, own, far, steps=30)
    assert front("standard_driver", Rules(passages=passages(yields=True)), own, far, steps=30)[-1] == free[-1]
    red = Rules(passages=passages(yields=True, north=0), signals=(shows("r"),))
    assert front("standard_driver", red, own, near, steps=10)[-1] == pytest.approx(
        front("standard_driver", alone, own, near, steps=10)[-1]
    )


def test_stop_sign_holds_everyone_once() -> None:
    rules = Rules(passages=passages(state="s"))
    x = front("standard_driver", rules, (35.0, 0.0, 0.0, 5.0), steps=150)
    assert np.diff(x).min() < 0.05
    assert x[-1] > 55.0


def test_who_stopped_first_at_an_all_way_stop_goes_first() -> None:
    both = passages(yields=True, state="w")
    rules = Rules(passages=(both[0], replace(both[1], yields_to=(0,), state="w")))
    scene = replace(scene_of((46.0, 0.0, 0.0, 0.0), (60.0, -14.0, np.pi / 2, 0.0)), rules=rules)
    driven = closed_loop(build(parse_models("standard_driver")[0]), CROSSROADS, scene, steps=40, replan=5)
    assert driven.x[0, 0, -1] > 52.0  # the lower number came first
    assert driven.y[0, 1, -1] < -11.0


@pytest.mark.parametrize("regulated", [True, False])
def test_lets_people_on_a_crosswalk_pass(regulated: bool) -> None:
    outline = np.array([(40.0, -4.0), (43.0, -4.0), (43.0, 4.0), (40.0, 4.0)])
    rules = Rules(passages=passages() if regulated else (), crosswalks=(outline,))
    rests = steady((41.5, -3.0, 0.0, 0.0), time_s=np.zeros(80))
    someone = people_of(rests, "pedestrian", length=0.5, width=0.5)
    assert front("standard_driver", rules, FAR, obstacles=someone, steps=80)[-1] < 40.0
    assert front("ignores_priority", rules, FAR, obstacles=someone, steps=80)[-1] > 45.0


def test_signal_repeats_and_knows_how_long_it_has_been_shown() -> None:
    signal = Signal(letters="GGyr", ends_s=np.array([5.0, 10.0, 13.0, 20.0]), start_s=3.0)
    assert signal.at(0.0) == ("G", pytest.approx(3.0, abs=1e-4))
    assert signal.at(6.0) == ("G", pytest.approx(9.0, abs=1e-4))
    assert signal.at(8.0)[0] == "y"
    assert signal.at(21.0) == ("G", pytest.approx(4.0, abs=1e-4))
    assert signal.at(-4.0)[0] == "r"
    assert Signal().at(3.0) == ("", 0.0)


def test_precedence_names_who_must_yield_and_who_has_red() -> None:
    scene = scene_of((25.0, 0.0, 0.0, 8.0), (60.0, -35.0, np.pi / 2, 10.0))
    yields = Rules(passages=passages(yields=True))
    assert precedence(replace(scene, rules=yields), CROSSROADS) == [(1, 2, "must yield")]
    red = Rules(passages=passages(yields=True, north=0, east=1), signals=(shows("r"), shows("G")))
    assert precedence(replace(scene, rules=red), CROSSROADS) == [(2, 1, "has red")]
    assert precedence(scene, CROSSROADS) == []
