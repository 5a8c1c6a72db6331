"""A small real run, and its report in a real browser."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from scex_sumo import example_path
from scex_sumo.page.report.report import write_report
from scex_sumo.results.run import Run, open_run
from tests.command import scex

UNFOLD = "for (const fold of document.querySelectorAll('details')) fold.open = true"
CHROMIUM = next((found for name in ("chromium", "chromium-browser") if (found := shutil.which(name))), None)


@pytest.fixture(scope="session")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """Sixty futures of the roundabout, with their report."""
    folder = tmp_path_factory.mktemp("report") / "out"
    words = ("--futures", 60, "--reference", "none", "--no-report", "-o", folder)
    scex("run", example_path("roundabout"), *words).check_returncode()
    run = open_run(folder)
    write_report(run)
    return run


@pytest.fixture(scope="session")
def answered(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """A few futures of the roundabout and the human-like ones, with a verdict and a report."""
    folder = tmp_path_factory.mktemp("answered") / "out"
    scex("run", example_path("roundabout"), "--futures", 24, "-o", folder).check_returncode()
    return open_run(folder)


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    """Chromium; what needs it is skipped where it is not installed."""
    if CHROMIUM is None:
        pytest.skip("no chromium: apt-get install chromium")
    playwright = pytest.importorskip("playwright.sync_api", reason="no playwright: pip install playwright")
    with playwright.sync_playwright() as started:
        chromium = started.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield chromium
        chromium.close()


@pytest.fixture(scope="session")
def tab(browser: Any) -> tuple[Any, list[str]]:
    """A page, whose renderer starts once, and what went wrong on it."""
    page, wrong = browser.new_page(accept_downloads=True), list[str]()
    page.on("console", lambda message: wrong.append(message.text))
    page.on("pageerror", lambda error: wrong.append(str(error)))
    page.on("request", lambda request: wrong.append(request.url) if is_foreign(request.url) else None)
    return page, wrong


@pytest.fixture
def page(tab: tuple[Any, list[str]], run: Run) -> Iterator[Any]:
    """The report, opened anew from disk on a laptop; nothing may be requested, nothing go wrong."""
    page, wrong = tab
    page.goto("about:blank")
    wrong.clear()
    page.set_viewport_size({"width": 1400, "height": 900})
    page.emulate_media(media="screen", color_scheme="light", reduced_motion="reduce")
    page.goto(Path(run.folder, "report.html").resolve().as_uri())
    page.wait_for_selector("#pairs tr.go")
    page.evaluate(UNFOLD)
    page.wait_for_selector("#encounters tr.go")
    yield page
    assert wrong == []


def is_foreign(url: str) -> bool:
    """Whether an address is anything but the file itself and what the page made."""
    return not url.startswith(("file:", "blob:", "data:"))
