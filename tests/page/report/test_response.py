"""The map of critical responses follows its sliders, keys and the pair on the map."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from scex_sumo import example_path
from scex_sumo.page.report.report import write_report
from scex_sumo.results.run import Run, open_run
from tests.command import scex
from tests.page.report.test_browser import text

ROWS = "#response-table tbody tr"


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """Some futures of a merge, where leaders that brake are what it takes."""
    folder: Path = tmp_path_factory.mktemp("merge") / "out"
    words = ("--futures", 16, "--reference", "none", "--no-report", "-o", folder)
    scex("run", example_path("motorway_merge"), *words).check_returncode()
    write_report(open_run(folder))
    return open_run(folder)


def test_sliders_change_p_and_the_button_brings_it_back(page: Any, run: Run) -> None:
    p = f"{ROWS} td:nth-child(3)"
    page.locator(p).first.click()
    before = page.locator(f"{ROWS} td").all_inner_texts()
    assert page.locator(p).all_inner_texts() == page.locator(f"{ROWS} td:nth-child(4)").all_inner_texts()
    counted = page.locator(p).all_inner_texts()
    assert text(page, "#people output >> nth=0") == "1.25 s"
    page.locator("#people-median").fill("3")
    slow = page.locator(p).all_inner_texts()
    assert slow != counted == page.locator(f"{ROWS} td:nth-child(4)").all_inner_texts()
    page.wait_for_selector("#changes:has-text('collide about once in')", state="attached")
    page.click("#own-people")
    assert page.locator(f"{ROWS} td").all_inner_texts() == before


def test_a_row_selects_the_pair_on_the_map_and_the_pair_its_row(page: Any, run: Run) -> None:
    page.locator(ROWS).nth(1).click()
    names = text(page, f"{ROWS}:nth-child(2) td").split(" → ")
    page.wait_for_function(
        "(names) => names.every((name) => document.getElementById('pair-title').innerText.includes(name))",
        arg=names,
    )
    assert page.locator(f"{ROWS}.chosen").count() == 1
    first = text(page, f"{ROWS}:nth-child(1) td").split(" → ")
    page.evaluate(f"location.hash = 'pair={','.join(first)}'")
    page.wait_for_selector(f"{ROWS}:nth-child(1).chosen")


def test_arrows_on_the_map_of_responses_move_its_value_not_the_time(page: Any, run: Run) -> None:
    clock, said = text(page, "#clock"), text(page, "#response-said")
    page.locator("#response-map").focus()
    page.keyboard.press("ArrowRight")
    assert text(page, "#response-said") != said
    assert text(page, "#clock") == clock
    page.keyboard.press("ArrowLeft")
    assert text(page, "#response-said") == said
