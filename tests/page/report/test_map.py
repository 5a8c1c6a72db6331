"""The map moves, and the events of the shown future on it."""

from __future__ import annotations

from typing import Any

from scex_sumo.results.run import Run
from tests.page.report.test_browser import text

DRAWN = "(canvas) => canvas.toDataURL()"


def test_keys_move_the_map(page: Any) -> None:
    page.locator("#map").focus()
    before = page.eval_on_selector("#map", DRAWN)
    page.keyboard.press("Shift+ArrowLeft")
    page.wait_for_timeout(100)
    assert page.eval_on_selector("#map", DRAWN) != before


def test_events_of_the_shown_future_stand_on_the_time_bar(page: Any, run: Run) -> None:
    hits = run.collisions.to_pylist()
    hit = hits[0]
    page.evaluate(f"location.hash = 'future={hit['future']}&t=0'")
    page.wait_for_selector("#marks .hit")
    mine = [row for row in hits if row["future"] == hit["future"]]
    marks = page.locator("#marks .hit")
    assert marks.count() == len(mine)
    step = min(row["step"] for row in mine)
    assert marks.first.get_attribute("title").endswith(f", {step / 10:.1f} s")
    bar, mark = page.locator("#time").bounding_box(), marks.first.bounding_box()
    share = (mark["x"] + mark["width"] / 2 - bar["x"] - 8) / (bar["width"] - 16)
    assert abs(share - step / run.info["steps"]) < 0.01
    marks.first.click()
    page.wait_for_selector(f"#clock:has-text('{step / 10:.1f} s')")
    first = next(row for row in mine if row["step"] == step)
    assert all(str(first[name]) in text(page, "#pair-title") for name in ("track_id", "other_id"))


def test_e_leads_to_the_next_event_in_a_circle(page: Any) -> None:
    page.evaluate("location.hash = 't=0&future=' + document.getElementById('future').value")
    page.wait_for_selector("#clock:has-text('0.0 s')")
    times = sorted(
        {
            float(mark.get_attribute("title").split(", ")[-1].split()[0])
            for mark in page.locator("#marks button").all()
        }
    )
    assert times
    for time_s in (*times, times[0]):
        page.keyboard.press("e")
        page.wait_for_selector(f"#clock:has-text('{time_s:.1f} s')")
