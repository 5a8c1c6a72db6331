"""Command of a study: progress, interruption, notes."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

from typer import Option

from scex_sumo.commands.console import progress_bar, resumable, warn

Models = Annotated[
    str | None, Option(metavar="MODEL[@WEIGHT],...", help="Models to draw from; see 'scex-sumo models'.")
]


def run_study(study: Callable[..., Any], label: str, *, roots: list[Path], out: Path, **options: Any) -> Any:
    """Run a resumable study with the options of its command, show progress, and print its notes."""
    with progress_bar(label) as tick, resumable("seeds", out):
        done = study(roots, out=out, command=["scex-sumo", *sys.argv[1:]], progress=tick, **options)
    warn(done.info["notes"])
    return done
