"""Docs: commands, options and public names that a page names exist; pages are short, tables plain."""

from __future__ import annotations

import json
import re
from pathlib import Path

import click
import pytest
from typer.main import get_command

import scex_sumo as scex
from scex_sumo.cli import command_line

ROOT = Path(__file__).resolve().parents[1]
DOCS = sorted((ROOT / "docs").glob("*.md"))
PAGES = {page.name: page.read_text(encoding="utf-8") for page in (*DOCS, ROOT / "README.md")}
NOTEBOOK = json.loads((ROOT / "docs" / "tutorial.ipynb").read_text(encoding="utf-8"))
PAGES["tutorial.ipynb"] = "\n\n".join("".join(cell["source"]) for cell in NOTEBOOK["cells"])
MOST_WORDS = 13_000
OTHERS = {"--osc", "--window", "--fixed_timestep", "--traj_filter", "--pline_interpolation"}  # of esmini
OTHERS |= {"--device.fcd-replay.files"}
OTHERS |= {"--no-deps", "--target", "--collision-output", "--save-template", "--map-path"}  # of pip, of SUMO
OTHERS |= {"--fast"}  # of an extra


@pytest.fixture(scope="module")
def options() -> dict[str, set[str]]:
    """Options of each command."""
    group = get_command(command_line())
    assert isinstance(group, click.Group) or hasattr(group, "commands")
    return {
        name: {option for one in command.params for option in (*one.opts, *one.secondary_opts)} | {"--help"}
        for name, command in group.commands.items()
    }


def commands(text: str) -> list[tuple[str, str]]:
    """Name and rest of each command line of a page, in blocks and between backticks."""
    joined = text.replace("\\\n", " ")
    lines = [line for block in re.findall(r"^```.*?^```", joined, re.M | re.S) for line in block.splitlines()]
    inline = re.findall(r"`([^`\n]*(?:\n[^`\n]+)?)`", re.sub(r"^```.*?^```", "", joined, flags=re.M | re.S))
    found = [
        re.match(r"[$ ]*scex-sumo ([a-z]+)\b(.*)", line.replace("\n", " ")) for line in (*lines, *inline)
    ]
    return [(match[1], match[2].partition(" #")[0]) for match in found if match]


@pytest.mark.parametrize("page", PAGES)
def test_the_commands_of_a_page_exist_with_their_options(page: str, options: dict[str, set[str]]) -> None:
    for name, rest in commands(PAGES[page]):
        assert name in options, f"scex-sumo {name}"
        words = re.findall(r"(?<!\S)(--?[a-z][\w-]*)", re.sub(r"'[^']*'|\"[^\"]*\"", "", rest))
        assert not set(words) - options[name], f"scex-sumo {name}{rest}"


@pytest.mark.parametrize("page", PAGES)
def test_an_option_without_a_command_belongs_to_one(page: str, options: dict[str, set[str]]) -> None:
    known = set().union(*options.values()) | OTHERS
    named = set(re.findall(r"(?<![\w-])(--[a-z][\w.-]*\w)", PAGES[page]))
    named -= set(re.findall(r"(--[\w-]+)", " ".join(re.findall(r"benchmarks/\w+\.py[^`)]*", PAGES[page]))))
    assert not named - known


@pytest.mark.parametrize("page", PAGES)
def test_a_public_name_of_a_page_exists(page: str) -> None:
    for name in set(re.findall(r"\bscex\.(\w+)", PAGES[page])):
        assert name in scex.__all__ or hasattr(scex, name), name


@pytest.mark.parametrize("page", PAGES)
def test_no_cell_of_a_table_holds_a_row_of_numbers(page: str) -> None:
    for line in PAGES[page].splitlines():
        for cell in line.strip().strip("|").split("|") if line.startswith("|") else ():
            assert len(re.findall(r"\d\s*/(?=\s*[\d.])", cell)) < 2, cell


def test_the_pages_together_are_short() -> None:
    """Words have a letter or a digit; bars of tables are none."""
    words = [word for page in DOCS for word in page.read_text().split() if re.search(r"\w", word)]
    assert len(words) <= MOST_WORDS
