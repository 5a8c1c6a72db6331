"""Pages of studies: charts on their axes, tables that sort in a real browser, nothing that is requested."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scex_sumo.page.figures.charts import Plane, ticks, value_range
from scex_sumo.page.html import element
from scex_sumo.page.report.scene import lane_lines, outline_svg, scene_svg
from scex_sumo.page.study import card, plots, table, table_place, write_study
from tests.converters.plain_net import lane
from tests.converters.sumo_roads import road
from tests.page.conftest import is_foreign


@pytest.mark.parametrize(
    ("low", "high", "words"),
    [(0, 3, ["0", "1", "2", "3"]), (-0.3, 0.9, ["0.0", "0.5"]), (0.1, 199, ["50", "100", "150"])],
)
def test_ticks_are_round_and_within_the_axis(low: float, high: float, words: list[str]) -> None:
    assert [text for _, text in ticks(low, high)] == words


def test_a_plane_has_more_upwards_and_keeps_what_is_outside_at_its_edge() -> None:
    plane = Plane(x=(0, 10), y=(0, 2), width=100, height=50)
    assert plane.at(0, 0) == (0, 50)
    assert plane.at(5, 1) == (50, 25)
    assert plane.at(20, 3) == (100, 0)


def test_a_range_leaves_far_values_out_and_takes_near_marks_in() -> None:
    values = np.array([*np.linspace(1, 3, 20), 1000.0, np.inf])
    low, high = value_range(values, 4.0, 5000.0)
    assert low < 1 and 4 < high < 15
    assert value_range(np.array([np.inf])) == (0.0, 1.0)
    assert value_range(np.array([0.0, 0.2, 0.3]), 0.05)[0] == 0.0  # no density below 0
    assert value_range(np.array([8.0, 9.0]), 7.5)[0] == 7.4


def test_a_picture_has_the_lanes_that_touch_its_box_and_its_outlines() -> None:
    roads = road([lane(1, [(0, 0), (50, 0)]), lane(2, [(0, 500), (50, 500)])])
    box = (0.0, 50.0, -10.0, 10.0)
    picture = scene_svg("here", box, lane_lines(roads, box), [outline_svg("vehicle", 4.0, 2.0)])
    assert 'viewBox="0.0 -10.0 50.0 20.0"' in picture
    assert picture.count('class="vehicle"') == 1
    assert picture.count('class="junction"') == 1 < len(lane_lines(roads)) / 3


def test_columns_of_names_stand_left_and_those_of_numbers_right() -> None:
    heads = [("pair", "text", ""), ("count", "text", ""), ("who", "text", ""), ("why", "words", "")]
    columns = table(heads, [["1 – 2", 3, None, "it"], ["2 – 3", 4, "near", "is"]])["columns"]
    assert [column.get("kind") for column in columns] == [None, None, "names", "words"]


def test_a_page_shows_its_tables_sorted_by_a_click_and_asks_for_nothing(browser: Any, tmp_path: Path) -> None:
    heads = [("name", "text", ""), ("share", "percent", "of all")]
    rows = table(heads, [["b", 0.02], ["a", None], ["c", 0.5]])
    chart = Plane(x=(0, 1)).figure("shares", Plane(x=(0, 1)).dot(0.5, 0.5, "drawn"))
    cards = card("Numbers <here>", "A sentence.", table_place("numbers"), plots(chart, element("p", "a & b")))
    path = write_study(tmp_path / "page.html", "A study", "about", cards, tables={"numbers": rows})
    wrong: list[str] = []
    page = browser.new_page(viewport={"width": 390, "height": 800})
    page.on("console", lambda message: wrong.append(message.text))
    page.on("pageerror", lambda error: wrong.append(str(error)))
    page.on("request", lambda request: wrong.append(request.url) if is_foreign(request.url) else None)
    page.goto(path.resolve().as_uri())
    page.wait_for_selector("#numbers td")
    shown = [cell.strip() for cell in page.locator("#numbers td:first-child").all_inner_texts()]
    assert shown == ["b", "a", "c"]
    page.click("#numbers th:nth-child(2) button")
    shown = [cell.strip() for cell in page.locator("#numbers tr td").all_inner_texts()]
    assert shown == ["c", "50 %", "b", "2.0 %", "a", "–"]
    assert page.inner_text("h2") == "Numbers <here>"
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    assert wrong == []
    page.close()
