"""In a shell, Tab completes commands and options."""

from __future__ import annotations

import os

import pytest

from tests.command import scex


def completed(*words: str) -> list[str]:
    """What bash offers for the last of some words."""
    asked = {"COMP_WORDS": " ".join(("scex-sumo", *words)), "COMP_CWORD": str(len(words))}
    done = scex(env={**os.environ, **asked, "_SCEX_SUMO_COMPLETE": "complete_bash"})
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


@pytest.mark.parametrize(("words", "offered"), [(("vi",), {"view"}), (("view", "out", "--gr"), {"--grid"})])
def test_commands_and_options_are_completed(words: tuple[str, ...], offered: set[str]) -> None:
    assert set(completed(*words)) == offered
