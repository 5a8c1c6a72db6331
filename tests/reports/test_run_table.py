"""Tables fit the terminal: first without a frame, then in several lines, and no cell is ever cut off."""

from __future__ import annotations

import io
import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from rich.console import Console
from rich.table import Table

import scex_sumo
from scex_sumo.metrics.registry import SETS
from scex_sumo.page.report.tables import encounter_table
from scex_sumo.reports.console_table import print_table
from scex_sumo.reports.encounter_rows import meetings, worst_stress
from scex_sumo.reports.run_table import shown_columns, stress_lines, summary_table
from scex_sumo.reports.words import MAIN
from scex_sumo.results.run import Run, open_run
from scex_sumo.results.tables.encounters import QUESTIONS, SCHEMA
from tests.runs import extrapolate


def table(*, fold: bool = False) -> Table:
    """15 + 5 + 9 characters of content."""
    made = Table()
    made.add_column("metric", overflow="fold" if fold else "ellipsis", no_wrap=not fold)
    made.add_column("p", justify="right", no_wrap=True)
    made.add_column("worse : better", justify="right", no_wrap=True)
    made.add_row("traffic_quality", "0.001", "232 : 81x")
    return made


def printed(made: Table, width: int) -> list[str]:
    console = Console(file=io.StringIO(), width=width)
    print_table(made, console, breaks=(" better",))
    assert isinstance(console.file, io.StringIO)
    return [line.rstrip() for line in console.file.getvalue().splitlines()]


@pytest.mark.parametrize("width", [31, 10])
def test_a_narrow_terminal_gets_every_cell_whole_and_broken_headers(width: int) -> None:
    # 15, 5 and 9 characters with a space between: 31; a terminal of 10 breaks the lines by itself.
    assert printed(table(), width) == [
        "                        worse :",
        "metric              p    better",
        "traffic_quality 0.001 232 : 81x",
    ]


def test_a_narrow_terminal_gets_the_units_of_headers() -> None:
    made = Table("after [s]")
    made.add_row("1")
    assert printed(made, 3) == ["after [s]", "1"]


def result(folder: Path, values: dict[str, list[float | None]], **about: object) -> Path:
    """Write a result folder with metrics, independent draws, and thresholds of four metrics."""
    folder.mkdir(exist_ok=True)
    count = len(next(iter(values.values())))
    columns = {name: pa.array(column, pa.float64()) for name, column in values.items()}
    hits = pa.array([x == 1 for x in values.get("collision", [0] * count)])
    table = {"future": list(range(count))} | columns | {"collision": hits}
    pq.write_table(pa.table(table), folder / "metrics.parquet")
    pq.write_table(SCHEMA.empty_table(), folder / "encounters.parquet")
    info: dict[str, object] = {"seed_scene": {"name": "waiting", "vehicles": 2}, "futures": count}
    limits = {"distance": 5.0, "wttc": 0.26, "ttc": 0.5, "pet": 1.0, "drac": 3.4}
    info["thresholds"] = {name: limit for name, limit in limits.items() if name in values}
    (folder / "run.json").write_text(json.dumps(info | about))
    return folder


def test_the_main_metrics_are_the_table_and_the_papers_are_folded_below_them(tmp_path: Path) -> None:
    names = [each.name for each in (*SETS["paper"], *SETS["path"]) if each.name != "distance"]
    run = open_run(result(tmp_path, {name: [2.0, 3.0] for name in names}))
    assert shown_columns(run, every=False) == (list(MAIN), [])
    main, folded = shown_columns(run, every=True)
    assert main == [*MAIN, "pttc_path", "pet"] and folded == ["tq", "gap_time", "pttc", "wttc", "ttc"]


def cells(run: Run, metric: str) -> list[str]:
    made = summary_table(run, every=True)
    rows = list(zip(*(column.cells for column in made.columns), strict=True))
    (row,) = (row for row in rows if str(row[0]).startswith(metric))
    return [str(cell) for cell in row[1:]]


def test_what_no_future_defines_is_a_dash_and_each_set_has_its_own_denominator(tmp_path: Path) -> None:
    result(tmp_path, {"pet": [None] * 4, "drac": [1.0, np.inf, np.inf, np.inf], "collision": [0.0] * 4})
    result(tmp_path / "reference", {"pet": [0.5, None], "drac": [0.0, 0.0], "collision": [0.0, 0.0]})
    run = open_run(tmp_path)
    assert cells(run, "PET") == ["–", "–", "≤ 1", "50%", "–", "–", "0/4\n1/2"]
    assert cells(run, "DRAC")[:2] == ["–", "∞"] and cells(run, "DRAC")[-1] == "all"


def test_recorded_boxes_that_touch_are_no_infinite_drac_beside_no_collision(tmp_path: Path) -> None:
    result(tmp_path, {"drac": [1.0], "collision": [0.0]}, recorded={"overlaps": [], "left": {}})
    for value, collision, drac in ((np.inf, "contact", "–"), (2.0, "none", "2.00")):
        pq.write_table(pa.table({"drac": [value]}), tmp_path / "recorded.parquet")
        run = open_run(tmp_path)
        assert (cells(run, "collision")[0], cells(run, "DRAC")[0]) == (collision, drac)


def encounters(folder: Path, *rows: dict[str, object]) -> None:
    """Write ``encounters.parquet``; shares that are not given are 0 [0–1]."""
    shares = {
        f"{q}{end}": value for q in QUESTIONS for end, value in (("", 0.0), ("_low", 0.0), ("_high", 0.01))
    }
    usual = {
        "time_s": 1.0,
        "future": 0,
        "gap": 2.0,
        "gap_p05": 2.0,
        "model": "m",
        "other_model": "o",
        "models": [],
    }
    table = pa.Table.from_pylist([shares | usual | row for row in rows], schema=SCHEMA)
    pq.write_table(table, folder / "encounters.parquet")


def test_a_pair_that_collides_between_people_alone_is_found_before_those_of_the_stress_test(
    tmp_path: Path,
) -> None:
    """As at 158 s of a recorded intersection: 0 of 385 futures and 3 of 117."""
    result(tmp_path, {"collision": [0.0] * 385})
    encounters(tmp_path, {"track_id": 1, "other_id": 2}, {"track_id": 5, "other_id": 6})
    human = result(tmp_path / "reference", {"collision": [1.0] * 3 + [0.0] * 114})
    share = {"collision": 3 / 117, "collision_low": 0.0087, "collision_high": 0.0727, "critical": 3 / 117}
    encounters(human, {"track_id": 2, "other_id": 1} | share, {"track_id": 7, "other_id": 8})
    run = open_run(tmp_path)
    (stress,) = stress_lines(run)
    assert stress.startswith("stress test: a collision in 0.0 %")
    assert stress.endswith("no encounter of two vehicles is critical in any future")
    found = meetings(run)
    assert [(one.futures, one.pair) for one in found] == [
        ("human-like", (1, 2)), ("stress test", (1, 2)), ("stress test", (5, 6)), ("human-like", (7, 8)),
    ]  # fmt: skip
    assert worst_stress(run) == []
    table = encounter_table(run, [1, 2, 5, 6, 7, 8])
    assert [(row["cells"][1], row["future"]) for row in table["rows"]][:2] == [
        ("human-like", 385),
        ("stress test", 0),
    ]


CRITICAL = {
    "collision": 0.2,
    "collision_low": 0.1,
    "collision_high": 0.3,
    "critical": 0.2,
    "kind": "rear-end",
}


def test_doubtful_pairs_are_left_out_and_named(tmp_path: Path) -> None:
    doubt = "1 is off the mapped lanes"
    result(tmp_path, {"collision": [1.0, 0.0]})
    encounters(tmp_path, CRITICAL | {"track_id": 1, "other_id": 2, "doubt": doubt})
    lines = stress_lines(open_run(tmp_path))
    assert lines[-1].endswith(f"left out as doubtful: {doubt}")
    assert not any("1 → 2" in line for line in lines)


@pytest.mark.parametrize(
    ("models", "words"),
    [
        (["likely_driver"], "driven as people were recorded"),
        (["risky_driver"], "driven as risky_driver"),
        (["risky_driver", "standard_driver"], "driven as any of the models"),
    ],
)
def test_a_run_says_how_its_vehicles_are_driven(tmp_path: Path, models: list[str], words: str) -> None:
    drawn = [{"model": model, "weight": 1.0} for model in models] + [{"model": "replay", "weight": 0.0}]
    run = open_run(result(tmp_path, {"collision": [0.0] * 4}, models=drawn))
    assert stress_lines(run)[0].endswith(f"{words}; no encounter of two vehicles is critical in any future")


def test_longer_runs_tell_the_probability_of_a_collision_by_horizon(tmp_path: Path) -> None:
    scene = scex_sumo.read_seed(scex_sumo.example_path("roundabout"))
    run = extrapolate(scene, futures=24, steps=35, metrics=["gap"], world="plain", out=tmp_path / "out")
    shares = [run.p_collision_by(seconds).value for seconds in (1.0, 3.0, 3.5)]
    assert shares == sorted(shares)
    assert shares[-1] == run.collision.value > 0
    rows = list(summary_table(run).columns[0].cells)
    assert [str(row) for row in rows if "by" in str(row)] == [f"collision by {s} s" for s in (1, 2, 3)]
