"""Help: commands by what one wants, lines of 80 columns, an example that works on the shipped data."""

from __future__ import annotations

import os
import re
import shlex
import shutil
from pathlib import Path

import pytest

from scex_sumo.commands.help import GROUPS, copyable
from scex_sumo.commands.shared import COMMANDS
from scex_sumo.drivers.listing import known_models
from tests.command import scex

ROOT = Path(__file__).resolve().parents[2]
NARROW = {**os.environ, "COLUMNS": "80"}
SHORTER = {
    "run": ("--futures", "9", "--no-report"),
    "catalogue": ("--count", "2", "--every", "9", "--to", "none"),
    "rank": ("--futures", "2", "--every", "9", "--top", "1"),
    "validate": ("--futures", "2", "--every", "99"),
    "test": ("--futures", "4"),
    "watch": ("--futures", "0", "--to", "0.5"),
    "view": ("--write-only",),
}
"""Options with which a test does not wait."""
BY_HAND = "train"
"""It passes over 851 scenes: half a minute. `tests/learned` trains on less."""


def printed(*words: str) -> str:
    done = scex(*words, env=NARROW)
    assert done.returncode == 0, done.stderr
    assert all(len(line) <= 80 for line in done.stdout.splitlines()), done.stdout
    return done.stdout


def example(command: str) -> list[str]:
    """Words of the example that ends the help of a command."""
    end = printed(command, "--help").rpartition("\nExample:\n")[2].replace("\\\n", "")
    words = shlex.split(end)
    assert words[:2] == ["scex-sumo", command]
    return words[1:]


def test_all_commands_are_listed_by_what_one_wants() -> None:
    text = printed("--help")
    assert list(GROUPS) == re.findall(r"^(?!Usage|Options)(\w.*):$", text, re.MULTILINE)
    listed = re.findall(r"^  ([a-z]+)  +[A-Z]", text, re.MULTILINE)
    assert listed == [name for names in GROUPS.values() for name in names]
    assert set(listed) == set(COMMANDS.paths)
    assert "..." not in text.partition("\n\n")[2]  # no summary is cut


def test_the_options_of_a_run_have_groups() -> None:
    text = printed("run", "--help")
    groups = re.findall(r"^(\w.*):$", text, re.MULTILINE)
    assert groups == ["Arguments", "Input", "Futures and drivers", "Metrics", "People", "Output",
                      "Every command", "Example"]  # fmt: skip
    own = text.partition("Every command:")[0]
    assert len(re.findall(r"^  -", own, re.MULTILINE)) <= 30


def test_a_long_example_breaks_before_options() -> None:
    assert copyable("scex-sumo run map.osm --seed 1 -o out", 80) == ["scex-sumo run map.osm --seed 1 -o out"]
    lines = copyable("scex-sumo run map.osm --seed 1 -o out", 26)
    assert lines == ["scex-sumo run map.osm \\", "    --seed 1 -o out"]


def test_every_example_works_in_a_clone(tmp_path: Path) -> None:
    data = tmp_path / "scex_sumo" / "scenarios" / "data"
    others = shutil.ignore_patterns("motorway*", "urban*")
    shutil.copytree(ROOT / "scex_sumo" / "scenarios" / "data", data, ignore=others)
    first = ("run", "export", "catalogue")  # others take what these write
    for command in sorted(COMMANDS.paths, key=lambda name: (name not in first, name != "run")):
        words = example(command)
        if command != BY_HAND:
            done = scex(*words, *SHORTER.get(command, ()), cwd=tmp_path)
            assert done.returncode == 0, (words, done.stderr)


def test_a_list_of_models_has_at_most_five_parameters_each() -> None:
    text = printed("models")
    for model in known_models():
        assert model.name in text
    entries = re.split(r"\n(?=\w)", text.partition("\nMixes")[0])
    assert max(len(re.findall(r"\w=", entry)) for entry in entries) == 5
    assert "standard_driver" in entries[0] and "and 17 more" in entries[0]


@pytest.mark.parametrize("model", ["standard_driver", "graph_image_predictor", "keeps_way", "onnx"])
def test_one_model_is_shown_with_all_parameters_and_their_meanings(model: str) -> None:
    (info,) = (info for info in known_models() if info.name == model)
    rows = dict(re.findall(r"^(\w+)  +\S+  +(\S.*)", printed("models", model).partition("\n\n")[2], re.M))
    assert list(rows) == ["parameter", *(text.partition("=")[0] for text in info.parameters)]


def test_an_unknown_model_is_one_line() -> None:
    done = scex("models", "standart_driver")
    assert done.returncode == 2 and done.stderr.count("\n") == 1 and "standard_driver" in done.stderr
