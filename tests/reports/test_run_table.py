"""Tables fit the terminal: first without a frame, then in several lines, and no cell is ever cut off."""

from __future__ import annotations

import io
import json
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from rich.console import Console
from rich.table import Table

from scex_sumo.reports.run_table import always_critical, print_line, print_table
from scex_sumo.results.run import open_run


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


def test_a_wide_terminal_gets_a_frame() -> None:
    lines = printed(table(), 80)
    assert lines[0].startswith("┏")
    assert "worse : better" in lines[1]


@pytest.mark.parametrize("width", [31, 10])
def test_a_narrow_terminal_gets_every_cell_whole_and_broken_headers(width: int) -> None:
    # 15, 5 and 9 characters with a space between: 31; a terminal of 10 breaks the lines by itself.
    assert printed(table(), width) == [
        "                        worse :",
        "metric              p    better",
        "traffic_quality 0.001 232 : 81x",
    ]


def test_a_long_name_takes_two_lines_where_it_may() -> None:
    lines = printed(table(fold=True), 29)
    assert max(map(len, lines)) <= 29
    first, second = lines[-2:]
    assert first.split() == ["traffic_quali", "0.001", "232", ":", "81x"]
    assert second.split() == ["ty"]


def test_what_is_critical_in_every_child_is_told_apart(tmp_path: Path) -> None:
    values = {"distance": [3.0, 4.0], "wttc": [0.1, 0.9], "ttc": [1.0, None]}
    pq.write_table(pa.table({"child": [0, 1], **values}), tmp_path / "metrics.parquet")
    about = {"seed_scene": {"name": "waiting", "vehicles": 2}, "children": 2}
    limits = {"distance": 5.0, "wttc": 0.26, "ttc": 0.5}
    (tmp_path / "run.json").write_text(json.dumps(about | {"thresholds": limits}))
    assert always_critical(open_run(tmp_path)) == ["distance"]


@pytest.mark.parametrize(
    ("terminal", "lines"), [(True, ["  who drives", "    how"]), (False, ["  who drives how"])]
)
def test_a_sentence_is_broken_between_words_on_a_terminal_only(terminal: bool, lines: list[str]) -> None:
    console = Console(file=io.StringIO(), width=14, force_terminal=terminal, no_color=True)
    print_line("  who drives how", console)
    assert isinstance(console.file, io.StringIO)
    assert console.file.getvalue().splitlines() == lines
