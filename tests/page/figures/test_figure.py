"""Pictures and summary of a run show what the tables hold, undefined and one-sided cases included."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from matplotlib.figure import Figure
from rich.console import Console

from scex_sumo.base.errors import UsageError
from scex_sumo.metrics.registry import COLUMNS, THRESHOLDS
from scex_sumo.page.figures.figure import COLORS, plot
from scex_sumo.reports.run_table import summary_table
from scex_sumo.results.folder import ResultFolder, tracks_table, values_table
from scex_sumo.results.run import Run, open_run
from scex_sumo.results.tables.encounters import SCHEMA
from tests.command import script
from tests.results.test_folder import part_of
from tests.seeds import straight_seed

FUTURES = 40


@pytest.fixture
def run(tmp_path: Path) -> Run:
    """Forty futures whose distance is 0.25 m times their number; gap time defined in none, TTC in half."""
    folder = ResultFolder(tmp_path / "out", {})
    values = np.repeat(0.25 * np.arange(FUTURES)[:, None], len(COLUMNS), axis=1)
    defined = np.ones(values.shape, dtype=bool)
    defined[:, COLUMNS.index("gap_time")] = False
    defined[::2, COLUMNS.index("ttc")] = False
    metrics = values_table(COLUMNS, values, defined, np.arange(FUTURES))
    metrics = metrics.append_column("collision", pa.array([False] * FUTURES))
    folder.write_table("metrics.parquet", metrics)
    folder.write_table("encounters.parquet", SCHEMA.empty_table())
    folder.write_table("recorded.parquet", values_table(COLUMNS, values[8:9], defined[8:9]))
    part = part_of(list(range(FUTURES)), steps=4)
    folder.write_table("tracks.parquet", tracks_table(straight_seed(), part))
    scene = {"name": "hand made", "vehicles": 2}
    folder.finish({"seed_scene": scene, "steps": 4, "thresholds": dict(THRESHOLDS)})
    return open_run(tmp_path / "out")


def test_the_share_of_critical_futures_counts_those_up_to_the_threshold(run: Run) -> None:
    # 0.25 m times 0 to 20 is at most 5 m.
    assert run.p_critical("distance").value == pytest.approx(21 / FUTURES)
    assert run.p_critical("distance", threshold=0.1).value == pytest.approx(1 / FUTURES)


def test_plots_say_what_is_defined_and_mark_the_recorded_value(run: Run, tmp_path: Path) -> None:
    for file in (tmp_path / "densities.svg", tmp_path / "densities.png"):
        panels = plot([run], file, curve="density")
    text = (tmp_path / "densities.svg").read_text()
    assert [panel.get_title(loc="left") for panel in panels] == [
        *("distance", "traffic quality", "PTTC", "WTTC", "1/TTC")  # no empty panel: gap time is undefined
    ]
    assert "in 20 of 40" in text and "recorded" in text
    assert (tmp_path / "densities.png").stat().st_size > 10_000
    assert panels[0].figure.get_size_inches()[0] * 25.4 == pytest.approx(85)


@pytest.mark.parametrize("curve", ["density", "cumulative"])
def test_several_runs_share_axes_each_with_the_recorded_line_in_its_colour(run: Run, curve: str) -> None:
    (panel,) = plot(
        [run, run], None, curve=curve, labels=["a", "b"], metric="distance", ax=Figure().subplots()
    )
    curves = [line for line in panel.lines if len(np.asarray(line.get_xdata())) > 2]
    upright = [line for line in panel.lines if len(np.asarray(line.get_xdata())) == 2]
    assert [line.get_color() for line in curves] == list(COLORS[:2])
    recorded = [line for line in upright if line.get_linestyle() == "--"]
    assert [line.get_color() for line in recorded] == list(COLORS[:2])
    assert {np.asarray(line.get_xdata())[0] for line in recorded} == {0.25 * 8}
    (threshold,) = (line for line in upright if line not in recorded)
    assert np.asarray(threshold.get_xdata())[0] == THRESHOLDS["distance"]


def test_the_density_of_one_of_several_runs_integrates_to_one(run: Run) -> None:
    panels = plot(
        [run, run], None, curve="density", labels=["a", "b"], metric="distance", ax=Figure().subplots()
    )
    x, y = (np.asarray(values) for values in panels[0].lines[0].get_data())
    assert np.sum((y[1:] + y[:-1]) / 2 * np.diff(x)) == pytest.approx(
        1.0, abs=1e-3
    )  # no part of it is a stem


def test_a_figure_names_its_runs_also_if_their_names_are_long(run: Run, tmp_path: Path) -> None:
    labels = [f"DR_DEU_Roundabout_OF_000_t{moment}" for moment in (3.1, 104.6, 177.6)]
    panels = plot([run] * 3, tmp_path / "several.svg", curve="cumulative", labels=labels)
    figure = panels[0].figure
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == [*labels, "threshold", "recorded"]
    inside = figure.bbox.padded(1.0)
    assert all(inside.contains(*corner) for corner in legend.get_window_extent().corners())


def test_more_runs_than_colours_are_refused(run: Run) -> None:
    with pytest.raises(UsageError, match="9 results, but a figure has 8 colours"):
        plot([run] * 9, None, curve="density")


@pytest.mark.parametrize(("runs", "labels"), [(2, ["one"]), (1, ["one", "two"]), (0, None)])
def test_runs_without_a_label_each_are_refused(run: Run, runs: int, labels: list[str] | None) -> None:
    with pytest.raises(UsageError, match=rf"{runs} results and {len(labels or [])} labels"):
        plot([run] * runs, labels=labels)


def test_the_same_run_is_drawn_in_the_same_bytes(run: Run, tmp_path: Path) -> None:
    files = [tmp_path / "first.svg", tmp_path / "second.svg"]
    for file in files:
        plot([run], file, curve="cumulative")
    assert files[0].read_bytes() == files[1].read_bytes()


def test_runs_and_densities_are_drawn_into_axes_of_the_user(run: Run) -> None:
    axes = Figure().subplots()
    assert plot(run, metric="distance", ax=axes) == [axes] and axes.lines
    own = Figure().subplots()
    density = run.density("distance")
    assert density.plot(own) is own
    assert own.lines[0].get_ydata().tolist() == density.pdf.tolist()
    assert density.plot(own, curve="cumulative").lines[1].get_ydata().tolist() == density.cdf.tolist()
    with pytest.raises(UsageError, match="gap_time: defined in no future"):
        plot(run, metric="gap_time", ax=axes)


def test_the_summary_shows_shares_and_dashes(run: Run) -> None:
    console = Console(width=110, record=True)
    with console.capture() as capture:
        console.print(summary_table(run))
    rows = {line.split("│")[1].strip(): line for line in capture.get().splitlines() if line.startswith("│")}
    assert " 52% " in rows["distance [m]"]
    assert "2.00" in rows["distance [m]"]  # recorded
    assert "0/40" in rows["gap time [s]"]
    assert "20/40" in rows["1/TTC [1/s]"]


def test_pictures_leave_the_users_matplotlib_alone(run: Run, tmp_path: Path) -> None:
    code = (
        "import sys, matplotlib; matplotlib.use('svg'); from pathlib import Path\n"
        "from scex_sumo.page.figures import figure\n"
        "from scex_sumo.results.run import open_run\n"
        "figure.plot([open_run(Path(sys.argv[1]))], Path(sys.argv[2]))\n"
        "assert matplotlib.get_backend() == 'svg' and 'matplotlib.pyplot' not in sys.modules\n"
    )
    script(code, run.folder, tmp_path / "densities.png").check_returncode()
    assert (tmp_path / "densities.png").exists()
