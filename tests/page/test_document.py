"""Pages of studies: charts on their axes, tables that sort in a real browser, nothing that is requested."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from scex_sumo.page.document import Document, card, plots, table
from scex_sumo.page.figures.charts import Plane
from scex_sumo.page.html import element
from scex_sumo.page.picture import lane_lines, outline_svg, road_svg, scene_svg
from tests.converters.plain_net import lane
from tests.converters.sumo_roads import road
from tests.page.conftest import is_foreign


def test_a_picture_has_the_lanes_that_touch_its_box_and_its_outlines() -> None:
    roads = road([lane(1, [(0, 0), (50, 0)]), lane(2, [(0, 500), (50, 500)])])
    box = (0.0, 50.0, -10.0, 10.0)
    picture = scene_svg("here", box, road_svg(lane_lines(roads, box)), [outline_svg("vehicle", 4.0, 2.0)])
    assert 'viewBox="0.0 -10.0 50.0 20.0"' in picture
    assert picture.count('class="vehicle"') == 1
    assert picture.count('class="junction"') == 1 < len(lane_lines(roads)) / 3


def test_a_page_shows_its_tables_sorted_by_a_click_and_asks_for_nothing(browser: Any, tmp_path: Path) -> None:
    heads = [("name", "text", ""), ("share", "percent", "of all")]
    rows = table(heads, [["b", 0.02], ["a", None], ["c", 0.5]])
    chart = Plane(x=(0, 1)).figure("shares", Plane(x=(0, 1)).dot(0.5, 0.5, "drawn"))
    study = Document("A study")
    place = study.table("numbers", rows)
    cards = card("Numbers <here>", "A sentence.", place, plots(chart, element("p", "a & b")))
    path = study.write(tmp_path / "page.html", "about", cards)
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
