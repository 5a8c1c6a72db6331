"""The page of a ranking in a real browser: verdicts by keys, kept, saved and read again."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from scex_sumo import example_path
from scex_sumo.studies.rank.encounters import read_triage
from tests.command import scex
from tests.page.report.test_browser import BACK


@pytest.fixture(scope="module")
def ranking(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("ranking") / "out"
    words = ("--every", 9, "--futures", 2, "--top", 2, "-o", out)
    scex("rank", example_path("roundabout"), *words).check_returncode()
    return out


@pytest.fixture
def page(tab: tuple[Any, list[str]], ranking: Path) -> Any:
    page, wrong = tab
    wrong.clear()
    page.goto(f"file://{ranking / 'ranking.html'}")
    page.evaluate("localStorage.clear()")
    page.reload()
    page.locator("#counts", has_text="0 test").wait_for()  # its scripts have begun
    yield page
    assert wrong == []


def verdicts(page: Any) -> list[str]:
    return [cell.inner_text() for cell in page.locator("#all-encounters tbody tr td:last-child").all()[:2]]


def judge(page: Any) -> None:
    """The first card is to be tested, with a note; the second one is a data error."""
    for key in ("j", "1", "n"):
        page.keyboard.press(key)
    page.keyboard.type('sees, or "not"')
    for key in ("Enter", "j", "3"):
        page.keyboard.press(key)


def test_keys_judge_the_card_that_has_the_focus(page: Any) -> None:
    judge(page)
    assert verdicts(page) == ["test", "data error"]
    assert page.inner_text("#counts") == "1 test, 0 discard, 1 data error"
    page.keyboard.press("3")  # the same again takes it back
    assert verdicts(page) == ["test", "–"]


def test_the_browser_keeps_verdicts(page: Any) -> None:
    judge(page)
    page.reload()
    page.locator("#counts", has_text="1 test").wait_for()
    assert verdicts(page) == ["test", "data error"]
    assert page.locator(".note").first.input_value() == 'sees, or "not"'


def test_verdicts_are_saved_and_read_by_page_and_command(page: Any, tmp_path: Path) -> None:
    judge(page)
    with page.expect_download() as download:
        page.click("#save")
    file = tmp_path / "triage.csv"
    download.value.save_as(file)
    rows = read_triage(file)
    assert [(row["verdict"], row["note"]) for row in rows] == [("test", 'sees, or "not"'), ("data error", "")]
    page.evaluate("localStorage.clear()")
    page.reload()
    page.locator("#counts", has_text="0 test").wait_for()
    assert verdicts(page) == ["–", "–"]
    page.set_input_files("#read", file)
    page.locator("#counts", has_text="1 test").wait_for()
    assert verdicts(page) == ["test", "data error"]


def test_a_time_line_names_its_moments_and_a_drag_selects_a_span(page: Any) -> None:
    title = page.locator(".timeline .dot title").first.text_content()
    assert "9.1 s, " in title and "about once in" in title
    rows = page.locator("#all-encounters tbody tr")
    whole = rows.count()
    assert whole > 2
    box = page.locator(".timeline svg").bounding_box()
    for start, stop, shown in ((0.6, 0.9, 0), (0.0, 0.2, whole)):
        page.mouse.move(box["x"] + start * box["width"], box["y"] + 10)
        page.mouse.down()
        page.mouse.move(box["x"] + stop * box["width"], box["y"] + 10)
        page.mouse.up()
        assert rows.count() == shown
    assert page.locator("h2:has-text('Not to be tested: ')").count() == 1
    assert page.locator(".maps .dot").count() > 0
    page.locator(".timeline a").first.click()
    assert page.evaluate("location.hash").startswith("#encounter-")


def test_films_of_cards_play_with_stamps_that_go_back(browser: Any, ranking: Path) -> None:
    page, wrong = browser.new_page(), list[str]()
    page.on("pageerror", lambda error: wrong.append(str(error)))
    page.add_init_script(BACK)
    page.goto(f"file://{ranking / 'ranking.html'}#encounter-1")
    page.locator("rect.responds.hit").first.wait_for(state="attached", timeout=30_000)
    assert wrong == []
    page.close()


def test_the_two_vehicles_play_until_they_touch(page: Any) -> None:
    page.locator("article").first.scroll_into_view_if_needed()
    page.locator("rect.responds.hit").first.wait_for(state="attached", timeout=30_000)
