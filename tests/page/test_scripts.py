"""Our own scripts are valid, and so small that a person reads them."""

from __future__ import annotations

import re
import shutil
import subprocess
from importlib.resources import files
from pathlib import Path

import pytest

from scex_sumo.page.report.report import SCRIPTS as REPORT

ASSETS = Path(str(files("scex_sumo.page").joinpath("assets")))
SCRIPTS = sorted(ASSETS.glob("*.js"))
FORBIDDEN = (
    r"\t|\s$",
    r"\bvar\s|\beval\b|innerHTML|\bfetch\b|XMLHttpRequest|console\.",
    r"[^=!]==[^=]|!=[^=]",
)
"""Tabs and blanks at the end; what is unsafe, or asks the network; loose comparison."""
NODE = shutil.which("node")


@pytest.mark.skipif(NODE is None, reason="no node: apt-get install nodejs")
@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.name)
def test_a_script_is_valid_in_strict_mode(script: Path, tmp_path: Path) -> None:
    strict = tmp_path / script.name
    strict.write_text('"use strict";\n' + script.read_text())
    done = subprocess.run([str(NODE), "--check", str(strict)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.name)
def test_a_script_begins_with_what_it_is_and_keeps_to_the_style(script: Path) -> None:
    text = script.read_text()
    assert text.startswith("// ")
    assert max(map(len, text.splitlines())) <= 210
    for number, line in enumerate(text.splitlines(), 1):
        for rule in FORBIDDEN:
            assert not re.search(rule, line), f"{script.name}:{number}: {rule}"


def test_those_of_a_report_stay_small_together() -> None:
    assert sum((ASSETS / name).stat().st_size for name in REPORT) < 90_000
