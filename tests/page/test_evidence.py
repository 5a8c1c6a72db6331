"""Evidence sheet: its fields, its figures by hand, and one sheet of paper."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scex_sumo.certainty.evidence import avoidable, write_evidence
from scex_sumo.certainty.tables import Draws, InfluenceTable
from scex_sumo.results.run import Run


@pytest.fixture(scope="module")
def sheet(run: Run) -> Path:
    return write_evidence(run)


def test_it_has_the_fields_of_the_clauses_and_the_figures_of_the_run(run: Run, sheet: Path) -> None:
    text = re.sub(r"<[^>]+>", " ", sheet.read_text())
    fields = ("scenario (6.4)", "exposure (6.4)", "severity (6.4)", "controllability (6.4)")
    for field in (*fields, "acceptance criterion (6.5)", "residual risk (6.5)", "no conformity"):
        assert field in text, field
    assert run.collision.percent in text
    assert str(run.info["seed_scene"]["fingerprint"]) in text
    assert re.search(r"\d+ of 19 moments of the recording, 1 s apart", text)
    first = run.encounters.to_pylist()[0]
    assert f"{first['track_id']} → {first['other_id']}" in text


def test_what_braking_avoids_by_hand() -> None:
    """Two models, all cells of equal weight; 1 is the row, 2 the column."""
    draws = Draws(models=("constant_velocity", "emergency_brake"), shares=np.array([0.5, 0.5]))

    def share(outcomes: list[list[int]], pair: tuple[int, int] = (1, 2)) -> float | None:
        table = InfluenceTable(track_ids=(1, 2), draws=draws, outcomes=np.array(outcomes, bool), checked=100)
        return avoidable(table, pair)

    assert share([[1, 0], [1, 0]]) == 1.0
    assert share([[1, 1], [1, 1]]) == 0.0
    assert share([[1, 0], [0, 1]]) == 0.5  # both brake and collide: neither can do more
    assert share([[1, 0], [1, 0]], pair=(1, 9)) == 0.0
    assert share([[0, 0], [0, 0]]) is None


def test_it_prints_to_one_sheet_and_asks_for_nothing(browser: Any, sheet: Path) -> None:
    page = browser.new_page()
    wrong: list[str] = []
    page.on("console", lambda message: wrong.append(message.text))
    page.goto(sheet.resolve().as_uri())
    printed = page.pdf(prefer_css_page_size=True)
    page.close()
    assert len(re.findall(rb"/Type\s*/Page[^s]", printed)) == 1
    assert wrong == []
