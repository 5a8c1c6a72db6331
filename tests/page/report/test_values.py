"""Values of curves as text, changes that are said aloud, and thresholds beyond the axis within reach."""

from __future__ import annotations

from typing import Any

import numpy as np

from scex_sumo.results.run import Run
from scex_sumo.scene import LOGGED_HISTORY
from tests.page.report.test_browser import LIMIT, drag, text

CHART = "#charts .chart:first-child"


def cells(page: Any, selector: str) -> list[list[str]]:
    """Return the rows of a table that is not seen."""
    read = "(rows) => rows.map((row) => [...row.children].map((cell) => cell.textContent))"
    return list(page.eval_on_selector_all(f"{selector} tr", read))


def test_a_chart_has_the_quantiles_of_its_curves_as_text(page: Any, run: Run) -> None:
    page.wait_for_selector(f"{CHART} .sr td", state="attached")
    heads, values = cells(page, f"{CHART} .sr")
    samples = run.samples("distance")
    assert values[:2] == ["stress test", str(len(samples))]
    levels = {"least": 0, "5 %": 0.05, "25 %": 0.25, "median": 0.5, "75 %": 0.75, "95 %": 0.95, "largest": 1}
    assert heads[2:] == list(levels)
    expected = np.quantile(samples, list(levels.values()), method="inverted_cdf")
    np.testing.assert_allclose([float(value) for value in values[2:]], expected, atol=6e-4)
    page.click("#only-future")
    page.wait_for_selector(f"{CHART} .sr tr:nth-child(2)", state="attached")
    future = int(page.input_value("#future"))
    selected = cells(page, f"{CHART} .sr")[2]
    assert selected[:2] == ["selected", "1"]
    assert abs(float(selected[2]) - run.metrics["distance"][future].as_py()) < 6e-4


def test_the_strips_have_the_course_of_the_pair_as_text(page: Any, run: Run) -> None:
    row = run.encounters.to_pylist()[0]
    seen = [run.info["seed_scene"]["track_ids"].index(row[name]) for name in ("track_id", "other_id")]
    heads, *lines = cells(page, "#strips .sr")
    assert heads[1:3] == [f"speed {row['track_id']} [m/s]", f"speed {row['other_id']} [m/s]"]
    assert [line[0] for line in lines] == [f"{0.5 * k:.1f} s" for k in range(run.info["steps"] // 5 + 1)]
    states = run.states(row["future"])[seen, LOGGED_HISTORY - 1 :: 5]
    np.testing.assert_allclose([[float(v) for v in line[1:3]] for line in lines], states.speed.T, atol=0.07)
    page.click("#all")
    page.wait_for_selector("#strips .sr td:has-text(' to ')", state="attached")


def test_a_threshold_beyond_the_axis_is_within_reach_and_says_its_value(page: Any) -> None:
    page.wait_for_selector(f"{CHART} .sr td", state="attached")  # the charts are drawn
    own = float(page.input_value(LIMIT))
    page.fill(LIMIT, "99")
    page.locator(LIMIT).blur()
    page.wait_for_selector("#changes:has-text('P(distance ≤ 99 m) 100 % stress test')", state="attached")
    drag(page, f"{CHART} canvas", 0.999, 0.995)
    assert page.get_attribute(f"{CHART} canvas", "title").startswith("threshold ")
    drag(page, f"{CHART} canvas", 0.99, 0.8)
    assert float(page.input_value(LIMIT)) < 99
    assert float(page.input_value(LIMIT)) != own
    assert text(page, "#chips") == ""  # nothing was brushed
