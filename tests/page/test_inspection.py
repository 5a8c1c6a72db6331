"""The page of a recording shows who is where at each moment, and gives the command that runs one."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scex_sumo import example_path
from scex_sumo.converters.datasets.find import find_recordings
from scex_sumo.evaluation.recordings import load_recording, seed_at
from scex_sumo.page.packing import UNITS
from scex_sumo.studies.inspection.command import inspect_command
from tests.page.packed import unpack

DATA = re.compile(r'<script type="text/plain" id="data">([^<]*)</script>')
MAP = Path(example_path("roundabout"))


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """The page of the example roundabout."""
    inspect_command(MAP, out=tmp_path / "page.html")
    return tmp_path / "page.html"


def test_every_moment_has_the_vehicles_of_its_seed_scene(file: Path) -> None:
    info, arrays = unpack(DATA.search(file.read_text())[1])  # type: ignore[index]
    loaded = load_recording(find_recordings([MAP])[0])
    for m in (3, info["first"]):
        time_s, _, vehicles, _ = info["moments"][m]
        scene = seed_at(loaded, float(time_s))
        assert arrays["ids"][:vehicles, m].tolist() == sorted(scene.track_ids.tolist())
        order = np.argsort(scene.track_ids)
        places = np.stack([scene.now.x, scene.now.y], axis=1)[order]
        np.testing.assert_allclose(arrays["poses"][:vehicles, m, :2] * UNITS[0], places, atol=0.0101)
        assert (arrays["ids"][vehicles:, m] == -1).all()


def test_the_page_opens_at_the_fullest_moment_and_writes_the_command(browser: Any, file: Path) -> None:
    page = browser.new_page()
    wrong: list[str] = []
    page.on("console", lambda message: wrong.append(message.text))
    page.on("pageerror", lambda error: wrong.append(str(error)))
    page.goto(file.resolve().as_uri())
    page.wait_for_selector("#vehicles tr.go")
    info, _ = unpack(DATA.search(file.read_text())[1])  # type: ignore[index]
    moments, first = info["moments"], int(page.input_value("#time"))
    assert moments[first][3] == max(complete for *_, complete in moments)
    page.select_option("#model", "emergency_brake")
    page.locator("#vehicles tr.go").nth(1).click()
    page.wait_for_selector("#vehicles tr.chosen")
    track = page.inner_text("#vehicles tr.chosen td >> nth=0")
    said = page.inner_text("#command")
    assert f"--time {moments[first][0]} --assign {track}=emergency_brake -o out/" in said
    page.keyboard.press("ArrowLeft")
    page.wait_for_selector(f"#clock:has-text('{moments[first - 1][0]} s')")
    assert wrong == []
    page.close()
