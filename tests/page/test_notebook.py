"""In a notebook a run is its report; in a console runs and seed scenes are one line."""

from __future__ import annotations

import importlib.util
from html import unescape

import pytest

from scex_sumo import example_path, read_seed
from scex_sumo.base.errors import UsageError
from scex_sumo.results.run import Run
from tests.runs import extrapolate


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    out = tmp_path_factory.mktemp("run") / "out"
    return extrapolate(read_seed(example_path("roundabout")), futures=8, report=True, out=out)


def test_a_run_is_its_report_in_a_frame(run: Run) -> None:
    html = run._repr_html_()
    assert "a collision in" in repr(run)
    assert html.startswith("<iframe srcdoc=")
    assert unescape(html).count((run.folder / "report.html").read_text(encoding="utf-8")) == 1
    assert 'sandbox="allow-scripts"' in html


def test_a_seed_scene_is_one_line() -> None:
    scene = read_seed(example_path("roundabout"))
    assert (
        repr(scene)
        == f"SeedScene({scene.name!r}: 14 vehicles, {scene.future.shape[1]} steps recorded after it)"
    )  # type: ignore[union-attr]


def test_without_pandas_the_remedy_is_said(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(UsageError, match=r"pip install '\.\[notebook\]'"):
        run.to_pandas()
    with pytest.raises(UsageError, match="unknown table 'cars'; known: metrics"):
        run.to_pandas("cars")
