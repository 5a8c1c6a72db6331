"""The commands that make a result folder something to look at."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from scex_sumo import example_path
from scex_sumo.base.errors import ResultError, UsageError
from scex_sumo.exporters.command import export_command
from scex_sumo.page.command import report_command
from scex_sumo.page.plot_command import plot_command, short_names
from scex_sumo.results.run import open_run
from scex_sumo.views.command import view_command
from tests.command import scex


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run as the command line makes it."""
    out = tmp_path_factory.mktemp("run") / "out"
    done = scex("run", example_path("roundabout"), "--futures", 4, "-o", out)
    assert f"report: {out / 'report.html'}" in done.stdout
    return out


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
    plot_command([folder], metric="distance", curve="cumulative", out=file)
    assert file.read_bytes().startswith(start)


def test_what_cannot_be_drawn_is_said(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"unknown ending; known: \.svg, \.png, \.pdf"):
        plot_command([folder], metric=None, curve="density", out=tmp_path / "figure.gif")
    with pytest.raises(UsageError, match="unknown curve; known: density, cumulative"):
        plot_command([folder], metric=None, curve="histogram", out=None)
    with pytest.raises(UsageError, match="unknown metric 'speed'"):
        plot_command([folder], metric="speed", curve="density", out=tmp_path / "figure.svg")
    with pytest.raises(ResultError, match="no such folder"):
        report_command(tmp_path / "none")


def test_several_results_are_one_figure_and_a_table_of_their_p(folder: Path, tmp_path: Path) -> None:
    other = tmp_path / "other"
    done = scex("run", example_path("roundabout"), "--futures", 6, "--seed", 1, "--no-report", "-o", other)
    assert done.returncode == 0, done.stderr
    done = scex("plot", folder, other, "-o", tmp_path / "both.svg")
    assert done.returncode == 0, done.stderr
    lines = [re.findall(r"[^│┃]+", line) for line in done.stdout.splitlines() if line[:1] in "│┃"]
    rows = {cells[0].strip(): [cell.strip() for cell in cells[1:]] for cells in lines}
    runs = [open_run(out) for out in (folder, other)]
    assert rows[""] == ["out", "other"] and rows["futures"] == ["4", "6"]
    assert rows["collision"] == [run.collision.percent for run in runs]
    assert rows["collision, human-like"] == [run.reference.collision.percent for run in runs if run.reference]
    shares = [run.p_critical("ttc").percent for run in runs]
    assert [cell.rstrip("*") for cell in rows["1/TTC ≥ 0.667 1/s"]] == shares
    text = (tmp_path / "both.svg").read_text()
    assert ">out<" in text and ">other<" in text and ">recorded<" in text
    assert done.stdout.splitlines()[-1] == str(tmp_path / "both.svg")


def test_results_that_do_not_fit_on_common_axes_are_refused(folder: Path, tmp_path: Path) -> None:
    longer = shutil.copytree(folder, tmp_path / "longer")
    info = json.loads((longer / "run.json").read_text())
    (longer / "run.json").write_text(json.dumps({**info, "steps": 50}))
    with pytest.raises(ResultError, match="longer: steps in a future 50, but out has 30"):
        plot_command([folder, longer], out=tmp_path / "both.svg")
    with pytest.raises(UsageError, match="named twice"):
        plot_command([folder, folder / "." / ".." / "out"], out=tmp_path / "both.svg")
    with pytest.raises(ResultError, match="no such folder"):
        plot_command([folder, tmp_path / "none"], out=tmp_path / "both.svg")


def test_names_of_results_are_as_long_as_needed() -> None:
    assert short_names([Path("/out/a"), Path("/out/b")]) == ["a", "b"]
    assert short_names([Path("/x/one/v1"), Path("/x/two/v1")]) == ["one/v1", "two/v1"]


def test_a_collision_has_no_density_and_a_printed_name_is_understood(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="--metric collision: is 0 or 1 in each future and has no density"):
        plot_command([folder], metric="collision", curve="density", out=tmp_path / "figure.svg")
    plot_command([folder], metric="TTC", curve="density", out=tmp_path / "printed.svg")
    plot_command([folder], metric="ttc", curve="density", out=tmp_path / "column.svg")
    assert (tmp_path / "printed.svg").read_bytes() == (tmp_path / "column.svg").read_bytes()


def test_the_page_draws_its_curves_from_the_values_of_the_futures(folder: Path, tmp_path: Path) -> None:
    copy = shutil.copytree(folder, tmp_path / "out")
    report_command(copy)
    before = (copy / "report.html").read_bytes()
    (copy / "densities.parquet").unlink()
    report_command(copy)
    assert (copy / "report.html").read_bytes() == before


@pytest.mark.parametrize("command", ["report", "plot", "encounters", "export"])
def test_files_that_do_not_fit_together_are_one_line(folder: Path, tmp_path: Path, command: str) -> None:
    copy = shutil.copytree(folder, tmp_path / "out")
    info = json.loads((copy / "run.json").read_text())
    info["steps"] = 0
    (copy / "run.json").write_text(json.dumps(info))
    encounters = pq.read_table(copy / "encounters.parquet")
    pq.write_table(encounters.drop_columns(["collision"]), copy / "encounters.parquet")
    metrics = pq.read_table(copy / "metrics.parquet")
    pq.write_table(metrics.drop_columns(["collision"]), copy / "metrics.parquet")
    pq.write_table(pq.read_table(copy / "worst.parquet").drop_columns(["metric"]), copy / "worst.parquet")
    words = {"export": ["--future", 0, "--to", "gif", "-o", tmp_path / "x.gif"]}.get(command, [])
    done = scex(command, copy, *words)
    assert (done.returncode, done.stderr.count("\n")) == (1, 1) and done.stderr.startswith("error: ")


@pytest.mark.parametrize("what", ["report", "view", "grid", "export"])
def test_no_command_reads_the_states_of_all_futures_at_once(
    folder: Path, tmp_path: Path, what: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def read(file: Path, **_: object) -> None:
        raise AssertionError(f"{file} was read as a whole")

    monkeypatch.setattr("scex_sumo.results.tables.states.read_states", read)
    copy = shutil.copytree(folder, tmp_path / "out")
    if what == "report":
        report_command(copy)
    elif what == "export":
        export_command(copy, future=3, to="interaction", out=tmp_path / "future.csv")
        assert (tmp_path / "future.csv").read_text().count("\n") == 1 + 14 * 40
    else:
        view_command(
            copy, future=3 if what == "view" else None, grid=4 if what == "grid" else None, write_only=True
        )
