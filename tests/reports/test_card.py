"""The answer fits a terminal of 80 columns: 14 lines, no number broken, the verdict first and last."""

from __future__ import annotations

import io
import re
from dataclasses import replace
from pathlib import Path

import pytest
from rich.console import Console

import scex_sumo as scex
from scex_sumo.reports.card import COLUMNS, LINES, chance, pair_lines, percent, print_card, print_closing
from scex_sumo.results.decision import DISAGREE, VERDICTS
from scex_sumo.results.run import Run, open_run
from scex_sumo.results.tables.pairs import NARROW, arrow, told_pairs
from scex_sumo.scenarios import EXAMPLES
from tests.command import scex as command


@pytest.fixture(scope="module", params=EXAMPLES)
def run(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Run:
    """A run of an example seed."""
    scene = scex.read_seed(scex.example_path(request.param))
    out = tmp_path_factory.mktemp("card") / request.param
    return scex.extrapolate(scene, futures=64, reference="likely", report=False, out=out)


def card(run: Run, columns: int) -> list[str]:
    console = Console(file=io.StringIO(), width=columns, force_terminal=True, color_system=None)
    print_card(run, console)
    print_closing(run, console)
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue().splitlines()


@pytest.mark.parametrize("columns", [80, 100, 120])
def test_the_answer_has_14_lines_of_80_columns_and_breaks_no_number(run: Run, columns: int) -> None:
    lines = card(run, columns)
    assert max(map(len, lines)) <= columns
    assert len(lines) + 2 <= LINES  # the command adds where the report is, and how to look
    for line in lines:
        assert not re.search(r"\d$", line.rstrip()) or line.rstrip().endswith("moments") or "(" in line
        assert not re.match(r"\s*000", line)


def test_the_verdict_is_below_the_moment_and_the_last_line(run: Run) -> None:
    told, lines = run.decision, card(run, COLUMNS)
    assert told is not None and told.pair is not None
    word = VERDICTS[told.kind].upper()
    (first,) = (line for line in lines[1:3] if line.startswith(word))  # the moment may take two lines
    pair = f"{told.pair[0]} → {told.pair[1]}"
    assert pair in first and pair in lines[-1] and lines[-1].startswith(word)


def test_people_and_stress_test_stand_side_by_side_and_are_those_of_the_tables(run: Run) -> None:
    lines, table = pair_lines(run), {(row["track_id"], row["other_id"]): row for row in told_pairs(run)}
    shares = {frozenset((row["track_id"], row["other_id"])): row for row in run.encounters.to_pylist()}
    assert run.decision is not None and lines[0].pair == run.decision.pair
    for one in lines:
        met = shares.get(frozenset(one.pair))
        assert one.stress == (0.0 if met is None else met["collision"])
        assert one.people == (table[one.pair]["probability"] if one.pair in table else None)
    told = [one.people for one in lines if one.people is not None]
    assert told == sorted(told, reverse=True)


def test_the_pair_of_the_verdict_has_a_line_wherever_it_ranks(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Models disagree about a pair that people hardly ever bring to a contact."""
    shown = [one.pair for one in pair_lines(run)]
    told = told_pairs(run)
    rare = ([row for row in told if (row["track_id"], row["other_id"]) not in shown] or told)[-1]
    pair = rare["track_id"], rare["other_id"]
    assert run.decision is not None
    monkeypatch.setattr(run, "decision", replace(run.decision, kind=DISAGREE, pair=pair))
    assert any(one.pair == pair for one in pair_lines(run))
    assert any(line.startswith(f"{arrow(rare)} ") for line in card(run, COLUMNS))


def test_shares_and_chances_in_words() -> None:
    assert percent(0.0) == f"0{NARROW}%" and percent(1e-3) == f"<{NARROW}1{NARROW}%"
    assert percent(0.244) == f"24{NARROW}%"
    assert chance(2.9e-6) == f"1{NARROW}in{NARROW}300{NARROW}000" and chance(0.97) == f"97{NARROW}%"


def test_the_command_prints_the_answer_on_14_lines_and_the_metrics_on_request(tmp_path: Path) -> None:
    words = ("run", scex.example_path("roundabout"), "--futures", 16, "-o", tmp_path / "out", "--no-report")
    short = command(*words).stdout.splitlines()
    assert len(short) <= LINES and max(map(len, short[:-3])) <= COLUMNS
    assert short[-1].startswith(short[1].partition("  ")[0])
    assert f"scex-sumo view {tmp_path / 'out'}" in short[-2]
    assert "critical if" not in "".join(short)
    told = command(*words, "--details").stdout
    assert "critical if" in told and "stress test: a collision in" in told
    assert open_run(tmp_path / "out").decision is not None
