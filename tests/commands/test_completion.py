"""In a shell, Tab completes commands, options and values."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from scex_sumo.commands.options import complete_results
from tests.command import scex


def completed(*words: str) -> list[str]:
    """What bash offers for the last of some words."""
    asked = {"COMP_WORDS": " ".join(("scex-sumo", *words)), "COMP_CWORD": str(len(words))}
    done = scex(env={**os.environ, **asked, "_SCEX_SUMO_COMPLETE": "complete_bash"})
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


@pytest.mark.parametrize(
    ("words", "offered"),
    [
        (("vi",), {"view"}),
        (("view", "out", "--gr"), {"--grid"}),
        (("plot", "out", "--metric", "wt"), {"wttc", "wttc_path"}),
        (("run", "map.osm", "--models", "replay,risky"), {"replay,risky_driver"}),
        (("export", "out", "--to", "open"), {"openscenario", "openscenario-1.3"}),
    ],
)
def test_commands_options_and_values_are_completed(words: tuple[str, ...], offered: set[str]) -> None:
    assert set(completed(*words)) == offered


def test_result_folders_are_those_that_hold_a_result(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("out/k733", "out/k729", "other"):
        (tmp_path / name).mkdir(parents=True)
    for name in ("out/k733", "out/k729"):
        (tmp_path / name / "run.json").write_text("{}")
    monkeypatch.chdir(tmp_path)
    assert complete_results("o") == complete_results("out/k7") == ["out/k729", "out/k733"]
    assert complete_results(f"{tmp_path}/out/k73") == [f"{tmp_path}/out/k733"]
