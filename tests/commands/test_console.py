"""What files and their names say is printed, and never commands the terminal."""

from __future__ import annotations

import io
import json
import os
import pty
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest

import scex_sumo
from scex_sumo.commands.console import PrintableStream, printable
from tests.runs import extrapolate

TITLE = "\x1b]0;evil\x1b\\"  # changes the title of a terminal's window
ESCAPED = "\\x1b]0;evil\\x1b\\"
ROUNDABOUT = scex_sumo.example_path("roundabout")


def on_a_terminal(*arguments: object) -> str:
    """Everything that a command writes where its output is a terminal."""
    master, slave = pty.openpty()
    command = [sys.executable, "-m", "scex_sumo", *map(str, arguments)]
    with subprocess.Popen(command, stdin=slave, stdout=slave, stderr=slave):
        os.close(slave)
        written = b""
        with suppress(OSError):  # the end, as Linux tells it
            while part := os.read(master, 65536):
                written += part
    os.close(master)
    return written.decode()


@pytest.mark.parametrize(
    ("text", "printed"),
    [
        ("a\tb\nc – ü 車", "a\tb\nc – ü 車"),
        (TITLE, ESCAPED),
        ("a\rb\x9b2J\x7f", r"a\rb\x9b2J\x7f"),
        ("a\u202eb", r"a\u202eb"),
    ],
)
def test_control_characters_are_escaped(text: str, printed: str) -> None:
    assert printable(text) == printed
    stream = io.StringIO()
    print(text, end="", file=PrintableStream(stream))
    assert stream.getvalue() == printed


def test_names_in_results_and_of_files_do_not_reach_a_terminal_unescaped(tmp_path: Path) -> None:
    out = tmp_path / f"o{TITLE}"
    extrapolate(scex_sumo.read_seed(ROUNDABOUT), futures=2, out=out)
    info = json.loads((out / "run.json").read_text())
    info["seed_scene"]["name"] += TITLE
    (out / "run.json").write_text(json.dumps(info))
    tracks = tmp_path / "tracks.csv"
    tracks.write_text(f"track_id,{TITLE}frame_id\n1,1\n")
    for arguments in (
        ("encounters", out),
        ("plot", out, "--metric", "ttc"),
        ("run", ROUNDABOUT, "--tracks", tracks),
    ):
        written = on_a_terminal(*arguments)
        assert r"\x1b]0;evil" in written and "\x1b]" not in written, arguments
