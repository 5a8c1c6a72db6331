"""The page integrates P from the maps as Python does, also with other people."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scex_sumo import example_path, read_seed
from scex_sumo.certainty.response.answer import responses_and_maps
from scex_sumo.certainty.response.motion.actions import ACTIONS, BRAKES
from scex_sumo.certainty.response.people import People, people_of, probabilities
from scex_sumo.certainty.response.played import played
from tests.page.test_numbers import evaluated

pytestmark = pytest.mark.skipif(shutil.which("node") is None, reason="no node: apt-get install nodejs")
SCRIPTS = ("data.js", "response.js")
PLAYED = ("data.js", "pairs.js", "acting.js")


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """People that see less of what grows: they touch also where there is time to respond."""
    file = tmp_path_factory.mktemp("maps") / "people.json"
    file.write_text(json.dumps({"growth": 10.0}))
    return file


@pytest.fixture(scope="module")
def maps(file: Path) -> dict[str, Any]:
    """Maps of the roundabout: braking, and going on."""
    table, found = responses_and_maps(read_seed(example_path("roundabout")), file)
    assert {pair["action"] for pair in found["pairs"]} == {"brakes", "goes on"}
    assert [pair["probability"] for pair in found["pairs"]] == table["probability"].to_pylist()[
        : len(found["pairs"])
    ]
    return found


def in_python(people: People, pair: dict[str, Any], kind: int) -> float:
    """Return P of a map by `People.later` and `probabilities`."""
    responses = np.array(
        [[np.inf if r is None else -np.inf if r < 0 else r for r in line] for line in pair["responses"]]
    )
    gap = np.array(np.inf if pair["gap"] is None else pair["gap"])
    late = people.later(responses, np.array(kind), gap, np.array(pair["left"])) @ people.decelerations
    return float(probabilities(np.array([pair["often"]]), late[None], np.array([kind]))[0])


def on_page(maps: dict[str, Any]) -> list[float]:
    text = json.dumps(maps)
    found = evaluated(SCRIPTS, f"{text}.pairs.map((pair) => responseProbability({text}.people, pair))")
    return list(found)


def test_the_page_integrates_the_p_of_the_table(maps: dict[str, Any]) -> None:
    wanted = [pair["probability"] for pair in maps["pairs"]]
    np.testing.assert_allclose(on_page(maps), wanted, rtol=1e-4)  # six digits are written, R* to 1 ms


@pytest.mark.parametrize(("factor", "away"), [(0.5, 0.0), (2.5, 0.2), (1.0, 0.9)])
def test_with_other_people_it_is_that_of_python(
    maps: dict[str, Any], file: Path, factor: float, away: float
) -> None:
    people = replace(people_of(file).slower(factor), away_share=away)
    names = [action["name"] for action in maps["people"]["actions"]]
    wanted = [in_python(people, pair, names.index(pair["action"])) for pair in maps["pairs"]]
    changed = {**maps["people"], "response_s": people.response_s.tolist(), "away_share": away}
    found = on_page({**maps, "people": changed})
    np.testing.assert_allclose(found, wanted, rtol=1e-5)
    assert any(abs(a / b["probability"] - 1) > 0.1 for a, b in zip(found, maps["pairs"], strict=True))


def test_tails_of_the_normal_distribution_keep_their_digits() -> None:
    z = [-3.0, 0.0, 1.0, 2.5, 4.7, 8.0]
    from scipy.special import ndtr

    np.testing.assert_allclose(evaluated(SCRIPTS, f"{z}.map(tailOf)"), ndtr(-np.array(z)), rtol=3e-7)


def acted(maps: dict[str, Any], number: int, level: int, response: float) -> dict[str, Any]:
    """Return what the page plays at a point of a map: poses of both, and the speed of the impact."""
    scene = read_seed(example_path("roundabout"))
    place = {int(track): v for v, track in enumerate(scene.track_ids)}
    pair = maps["pairs"][number]
    both = [place[pair[name]] for name in ("track_id", "other_id")]
    sizes = np.stack([scene.length, scene.width], axis=1)[both].tolist()
    people = json.dumps(maps["people"])
    call = f"actedBy({json.dumps(pair)}, {level}, {response}, {people}, {json.dumps(sizes)})"
    return dict(evaluated(PLAYED, call))


def test_what_plays_touches_if_the_response_comes_later_than_the_critical_one(maps: dict[str, Any]) -> None:
    """R* of the middle deceleration, to 0.15 s: poses are of every 0.1 s, and whole centimetres."""
    finite = [
        (number, level, line[1])
        for number, pair in enumerate(maps["pairs"])
        for level, line in enumerate(pair["responses"])
        if line[1] is not None and line[1] > 0.2
    ]
    assert len(finite) >= 2
    for number, level, critical in (finite[0], finite[-1]):
        late, early = (acted(maps, number, level, critical + by) for by in (0.15, -0.15))
        assert late["speed"] is not None and early["speed"] is None
        assert len(early["poses"]) == 81 > len(late["poses"])


def test_what_plays_is_the_motion_that_a_ranking_plays(maps: dict[str, Any], file: Path) -> None:
    """To a few centimetres: there the response is calculated, here it is followed in small steps."""
    scene = read_seed(example_path("roundabout"))
    rows = responses_and_maps(scene, file)[0].to_pylist()
    number = next(k for k, row in enumerate(rows) if row["action"] == "brakes" and row["response_s"] > 0.2)
    row = rows[number]
    level = ACTIONS[BRAKES].values.index(row["value"])
    median = people_of().response_s[BRAKES]
    poses = np.array(acted(maps, number, level, max(row["response_s"] + 0.2, median))["poses"])
    states = played(scene, row)
    assert abs(len(poses) - states.shape[1]) <= 1
    steps = min(len(poses), states.shape[1])
    for place, wanted in enumerate((states.x, states.y, states.heading)):
        np.testing.assert_allclose(poses[:steps, :, place], wanted.T[:steps], atol=0.06)
