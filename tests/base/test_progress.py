"""Progress bars of functions, and notes as warnings."""

from __future__ import annotations

import io
import sys

import pytest

from scex_sumo.base.progress import progress_of


class Terminal(io.StringIO):
    """Stream that says it is a terminal."""

    def isatty(self) -> bool:
        """Whether it is a terminal."""
        return True


def test_a_bar_is_drawn_on_a_terminal_only(monkeypatch: pytest.MonkeyPatch) -> None:
    for stream, drawn in ((Terminal(), True), (io.StringIO(), False)):
        monkeypatch.setattr(sys, "stderr", stream)
        with progress_of(True, "run") as tick:
            assert (tick is not None) == drawn
            if tick is not None:
                tick(1, 4)
                tick(4, 4)
        assert ("run" in stream.getvalue() and "100%" in stream.getvalue()) == drawn


class NotebookStream(io.StringIO):
    """Stream of a notebook, which is no terminal."""

    __module__ = "ipykernel.iostream"


def test_a_notebook_needs_no_widgets(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is printed meanwhile stays on standard output."""
    shell = type("ZMQInteractiveShell", (), {})()
    monkeypatch.setattr("builtins.get_ipython", lambda: shell, raising=False)
    stream, printed = NotebookStream(), io.StringIO()
    monkeypatch.setattr(sys, "stderr", stream)
    monkeypatch.setattr(sys, "stdout", printed)
    with progress_of(True, "run") as tick:
        assert tick is not None
        tick(4, 4)
        print("a driver's word")
    assert "100%" in stream.getvalue() and printed.getvalue() == "a driver's word\n"


def test_a_function_of_the_user_is_called_itself() -> None:
    with progress_of(print, "run") as tick, progress_of(False, "run") as nothing:
        assert tick is print and nothing is None
