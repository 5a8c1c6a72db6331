"""The commands that make a result folder something to look at."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from scex_sumo import example_path
from scex_sumo.commands.of_results.plot import plot_command
from scex_sumo.commands.of_results.report import report_command
from scex_sumo.errors import ResultError, UsageError


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run as the command line makes it."""
    out = tmp_path_factory.mktemp("run") / "out"
    command = [sys.executable, "-m", "scex_sumo", "run", str(example_path("roundabout")), "--children", "8"]
    done = subprocess.run([*command, "-o", str(out)], check=True, capture_output=True, text=True)
    assert f"report: {out / 'report.html'}" in done.stdout
    return out


def test_a_run_leaves_its_report_and_no_pictures(folder: Path) -> None:
    assert (folder / "report.html").is_file()
    assert not [*folder.glob("*.png"), *folder.glob("*.svg")]


def test_the_report_is_written_again(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = (folder / "report.html").read_bytes()
    (folder / "report.html").unlink()
    report_command(folder)
    assert capsys.readouterr().out.strip() == str(folder / "report.html")
    assert (folder / "report.html").read_bytes() == before


@pytest.mark.parametrize(("ending", "start"), [(".svg", b"<?xml"), (".png", b"\x89PNG"), (".pdf", b"%PDF")])
def test_figures_come_in_the_format_of_their_file(
    folder: Path, tmp_path: Path, ending: str, start: bytes
) -> None:
    file = tmp_path / f"figure{ending}"
    plot_command(folder, metric="distance", curve="cumulative", out=file)
    assert file.read_bytes().startswith(start)


def test_the_same_figure_has_the_same_bytes(folder: Path, tmp_path: Path) -> None:
    for name in ("one.pdf", "two.pdf"):
        plot_command(folder, metric=None, curve="density", out=tmp_path / name)
    assert (tmp_path / "one.pdf").read_bytes() == (tmp_path / "two.pdf").read_bytes()


def test_what_cannot_be_drawn_is_said(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"unknown ending; known: \.svg, \.png, \.pdf"):
        plot_command(folder, metric=None, curve="density", out=tmp_path / "figure.gif")
    with pytest.raises(UsageError, match="unknown curve; known: density, cumulative"):
        plot_command(folder, metric=None, curve="histogram", out=None)
    with pytest.raises(UsageError, match="unknown metric 'speed'"):
        plot_command(folder, metric="speed", curve="density", out=tmp_path / "figure.svg")
    with pytest.raises(ResultError, match="no such folder"):
        report_command(tmp_path / "none")
