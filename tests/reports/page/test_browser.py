"""In a real browser the report plays, brushes, jumps to encounters, follows thresholds, and saves."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

from scex_sumo.reports.page.report import write_report
from scex_sumo.results.run import Run, open_run


def text(page: Any, selector: str) -> str:
    return str(page.inner_text(selector))


def drag(page: Any, selector: str, start: float, stop: float) -> None:
    """Drag along a canvas, from one share of its width to another."""
    page.locator(selector).scroll_into_view_if_needed()
    box = page.locator(selector).bounding_box()
    y = box["y"] + 0.7 * box["height"]
    page.mouse.move(box["x"] + start * box["width"], y)
    page.mouse.down()
    page.mouse.move(box["x"] + (start + stop) / 2 * box["width"], y)
    page.mouse.move(box["x"] + stop * box["width"], y)
    page.mouse.up()
    page.wait_for_timeout(100)


def test_the_verdict_comes_first_and_says_what_the_tables_say(page: Any, run: Run) -> None:
    verdict = text(page, "#verdict")
    assert "P(collision)" in verdict
    collided = len(run.table("collisions.parquet")["child"].unique())
    assert f"{collided} of {run.children} futures" in verdict
    share = run.p_critical("wttc").value
    assert f"{100 * share:.0f} %" in verdict
    assert page.locator("#verdict li").count() == 3


def test_it_plays_to_the_end(page: Any) -> None:
    page.select_option("#speed", "2")
    page.keyboard.press("Space")
    page.wait_for_selector("#clock:has-text('3.0 s')", timeout=15_000)
    page.wait_for_selector("#play:has-text('▶')")


def test_an_encounter_leads_to_its_pair_child_and_step(page: Any) -> None:
    row = page.locator("#encounters tr.go").first
    pair = row.locator("td").first.inner_text().split(" → ")
    row.click()
    page.wait_for_selector("#pair-title:has-text('Gap of')")
    assert text(page, "#pair-title").startswith(f"Gap of {pair[0]} and {pair[1]}, future ")
    assert page.input_value("#child") != ""
    assert text(page, "#clock") == row.locator("td").last.inner_text()


def test_the_weights_move_every_exact_probability(page: Any, run: Run) -> None:
    assert run.exact is not None and run.exact.p_collision() is not None
    shown = text(page, "#any-collision")
    assert shown == f"{100 * run.p_collision():.2f} %"
    first = "#exact-table tbody tr:first-child td:nth-child(2)"
    own = text(page, first)
    page.locator("#weights input").nth(2).fill("0.7")  # constant_velocity; the others share the rest
    rest = {name: 0.1 for name in run.exact.models} | {"constant_velocity": 0.7}
    assert text(page, "#any-collision") == f"{100 * run.p_collision(rest):.2f} %"
    one, other = text(page, "#exact-table tbody tr:first-child td").split(" → ")
    pair = run.encounter(int(one), int(other)).probability(weights=rest)
    assert text(page, first) == f"{100 * pair:.2f} %" != own
    assert "keeps its speed (constant_velocity)" in text(page, "#exact-table")
    page.click("#own-weights")
    assert (text(page, "#any-collision"), text(page, first)) == (shown, own)


def test_a_brushed_metric_selects_the_children_everywhere(page: Any, run: Run) -> None:
    drag(page, "#charts .chart:first-child canvas", 0.02, 0.3)
    chosen = int(text(page, "#chips b").split(" of ")[0])
    assert 0 < chosen < run.children
    page.keyboard.press("ArrowDown")
    page.wait_for_timeout(100)
    first = int(page.input_value("#child"))
    assert run.metrics["distance"][first].as_py() < 0.4 * max(run.samples("distance"))
    page.keyboard.press("Escape")
    page.wait_for_timeout(100)
    assert text(page, "#chips") == ""


def test_a_dragged_threshold_moves_the_share(page: Any) -> None:
    before = text(page, "#verdict .share:nth-of-type(1)")
    limit = float(page.input_value(LIMIT))
    drag(page, "#charts .chart:first-child canvas", _grip(page), 0.95)
    assert float(page.input_value(LIMIT)) > limit
    assert text(page, "#verdict .share:nth-of-type(1)") != before


def test_a_threshold_that_is_dragged_back_has_the_share_of_the_table_again(page: Any, run: Run) -> None:
    share = "#charts .chart:first-child b"
    limit, before = float(page.input_value(LIMIT)), page.get_attribute(share, "title")
    page.fill(LIMIT, str(limit + 2))
    page.locator(LIMIT).blur()
    page.wait_for_function(f"before => document.querySelector('{share}').title !== before", arg=before)
    page.fill(LIMIT, str(limit + 0.05))
    page.locator(LIMIT).blur()
    page.wait_for_timeout(100)
    canvas, at = "#charts .chart:first-child canvas", _grip(page)
    drag(page, canvas, at, at + 0.01)
    found = run.p_critical("distance")
    assert float(page.input_value(LIMIT)) == limit
    assert page.get_attribute(share, "title") == before
    assert f"95 %: {100 * found.low:.0f} % – {100 * found.high:.0f} %" in before


LIMIT = "#charts .chart:first-child input"


def _grip(page: Any) -> float:
    """Where the first chart's threshold is, as a share of its width."""
    canvas = "#charts .chart:first-child canvas"
    page.evaluate("document.querySelector('#charts .chart input').scrollIntoView()")
    box = page.locator(canvas).bounding_box()
    cursors = [_cursor(page, box["x"] + x, box["y"] + 60, canvas) for x in range(int(box["width"]))]
    return (cursors.index("ew-resize") + 9) / float(box["width"])


def _cursor(page: Any, x: float, y: float, canvas: str) -> str:
    page.mouse.move(x, y)
    return str(page.eval_on_selector(canvas, "canvas => canvas.style.cursor"))


def test_a_driver_of_a_vehicle_selects_the_children_that_have_it(page: Any, run: Run) -> None:
    page.locator("#models td.go").first.click()
    page.wait_for_selector(".chip")
    track, model = text(page, ".chip").removesuffix(" ×").split(" as ")
    vehicle = run.info["seed_scene"]["track_ids"].index(int(track))
    expected = sum(run.models_of(child)[vehicle] == model for child in range(run.children))
    assert text(page, "#chips b").startswith(f"{expected} of ")


def test_commands_are_copied(page: Any) -> None:
    page.fill("#child", "7")
    page.locator("#child").blur()
    page.click("[data-copy*=view]")
    page.wait_for_selector("#said:has-text('copied')")
    assert text(page, "#said").endswith("--child 7")


@pytest.mark.parametrize(
    ("button", "ending", "start"),
    [("#save-png", ".png", b"\x89PNG"), ("#save-webm", ".webm", b"\x1aE\xdf\xa3")],
)
def test_pictures_and_films_are_saved(
    page: Any, tmp_path: Path, button: str, ending: str, start: bytes
) -> None:
    page.select_option("#speed", "2")
    with page.expect_download(timeout=15_000) as waiting:
        page.click(button)
    saved = tmp_path / "saved"
    waiting.value.save_as(saved)
    assert waiting.value.suggested_filename.endswith(ending)
    assert saved.read_bytes().startswith(start)
    assert saved.stat().st_size > 5_000


@pytest.mark.parametrize("width", [390, 820, 1600])
def test_nothing_is_wider_than_the_screen(page: Any, width: int) -> None:
    page.set_viewport_size({"width": width, "height": 800})
    page.wait_for_timeout(200)
    assert page.evaluate("document.documentElement.scrollWidth") <= width


def test_the_map_is_drawn_in_light_and_dark(page: Any) -> None:
    pixel = """() => {
        const copy = document.createElement("canvas").getContext("2d", { willReadFrequently: true });
        copy.drawImage(document.getElementById("map"), 0, 0);
        return copy.getImageData(3, 3, 1, 1).data[0];
    }"""
    light = page.evaluate(pixel)
    page.emulate_media(color_scheme="dark")
    page.wait_for_timeout(200)
    assert light > 150 > 60 > page.evaluate(pixel)


def test_the_worst_children_are_those_with_the_event(page: Any, run: Run) -> None:
    page.select_option("#focus", label="distance")
    page.wait_for_timeout(100)
    page.locator("#worst tr.go").first.click()
    page.wait_for_timeout(100)
    child = int(page.input_value("#child"))
    assert run.metrics["distance"][child].as_py() == min(run.samples("distance"))


def test_a_result_without_encounters_says_so(browser: Any, run: Run, tmp_path: Path) -> None:
    copy = tmp_path / "out"
    shutil.copytree(run.folder, copy)
    for name in ("collisions.parquet", "encounters.parquet"):
        (copy / name).unlink()
    pq.write_table(run.metrics.drop_columns(["collision"]), copy / "metrics.parquet")
    page = browser.new_page()
    page.goto(write_report(open_run(copy)).resolve().as_uri())
    page.wait_for_selector("#worst tr.go")
    assert "not in this result" in text(page, "#verdict")
    page.close()
