"""Time lines: the mark of a moment lies at its time and P, names its pair, and leads to its card."""

from __future__ import annotations

import re

from scex_sumo.decision.words import WHAT
from scex_sumo.page.html import Html
from scex_sumo.page.timeline import SHAPES, Happening, place_map, timeline, usual_level

ROW = {
    "track_id": 3,
    "other_id": 7,
    "person": None,
    "how": "7 brakes",
    "what": "crossing",
    "x": 5.0,
    "y": -2.0,
}


def happening(time_s: float, probability: float, link: str = "") -> Happening:
    return Happening.of(ROW | {"probability": probability}, time_s, link)


def test_each_kind_of_conflict_has_a_shape() -> None:
    assert set(SHAPES) == set(WHAT) and len(set(SHAPES.values())) == len(WHAT)


def test_marks_lie_at_their_time_and_probability_and_name_the_pair() -> None:
    marks = [happening(0.0, 1e-7), happening(5.0, 1e-3, "#encounter-1"), happening(10.0, 1e-9)]
    picture = timeline("here", marks, (0.0, 10.0), "here", (1e-6, 1e-4))
    places = [tuple(map(float, found)) for found in re.findall(r'd="M([\d.]+),([\d.]+)m', picture)]
    assert places == [(0.0, 96.0), (500.0, round(96 * 3 / 7, 1))]  # below one in ten million nothing is drawn
    assert "5 s, 3 → 7: 7 brakes; about once in 1\u202f000 such moments" in picture
    assert picture.count('href="#encounter-1"') == 1 and picture.count("area soft") == 1
    assert 'data-first="0" data-last="10"' in picture


def test_a_usual_level_needs_ten_moments() -> None:
    assert usual_level([1e-5] * 9) is None
    assert usual_level([1e-5] * 10 + [1e-2]) == (1e-5, 1e-5)


def test_a_map_has_its_places_in_metres() -> None:
    picture = place_map("site", (0.0, 100.0, -50.0, 50.0), Html(), [happening(0.0, 1e-3)])
    assert "translate(5.0 -2.0)" in picture and 'viewBox="0.0 -50.0 100.0 100.0"' in picture
