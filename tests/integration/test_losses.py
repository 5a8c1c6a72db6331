"""Losses of a map, as the terminal and the page tell them."""

from __future__ import annotations

from pathlib import Path

import pytest

from scex_sumo.cli import main
from tests.converters.maps import draw_map, straight


def test_a_large_loss_is_a_warning_with_its_share_on_the_terminal_and_on_the_page(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path, out = tmp_path / "road.osm", tmp_path / "out"
    drawn = draw_map([straight(1, 0, 300), straight(2, 300, 400), straight(3, 400, 500)])
    path.write_text(drawn.replace("relation id='3'", "relation id='three'"))
    options = [
        "--synthetic",
        "2",
        "--futures",
        "2",
        "--models",
        "rules",
        "--reference",
        "none",
        "-o",
        str(out),
    ]
    monkeypatch.setattr("sys.argv", ["scex-sumo", "run", str(path), *options])
    try:
        main()
    except SystemExit as stop:
        assert not stop.code
    warning = "warning: 1 of 3 lanelets (33%) left out, broken: three"
    assert warning in capsys.readouterr().err.splitlines()
    assert warning.removeprefix("warning: ") in (out / "report.html").read_text(encoding="utf-8")
