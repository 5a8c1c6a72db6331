"""Command line in a process that starts in milliseconds, forked off a server that has imported the package.

Tests of the start itself, of signals and of limits start Python anew.
"""

from __future__ import annotations

import multiprocessing
import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path

PRELOADED = (
    "scex_sumo.extrapolation.engine",
    "scex_sumo.commands.run",
    "scex_sumo.reports.run_table",
    "pandas",
)


def scex(
    *arguments: object,
    cwd: Path | None = None,
    path: Path | None = None,
    env: Mapping[str, str] | None = None,
    timeout: float = 120.0,
) -> subprocess.CompletedProcess[str]:
    """Run ``scex-sumo`` as its console script does, and return its status and what it printed.

    Args:
        cwd: folder in which it runs.
        path: folder from which it also imports.
        env: its environment; without it, that of the test.
        timeout: in s; a command that takes longer is killed and fails the test.
    """
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(list(PRELOADED))
    words = [*map(str, arguments)]
    with tempfile.TemporaryDirectory() as folder:
        files = [Path(folder, name) for name in ("stdout", "stderr")]
        given = (words, files, cwd or Path.cwd(), path, dict(os.environ if env is None else env))
        process = context.Process(target=_run, args=given)
        process.start()
        process.join(timeout)
        if process.is_alive():
            process.kill()
            raise subprocess.TimeoutExpired(words, timeout)
        out, errors = (file.read_text(encoding="utf-8") if file.exists() else "" for file in files)
        assert process.exitcode is not None
        return subprocess.CompletedProcess(words, process.exitcode, out, errors)


def _run(
    words: list[str], files: list[Path], cwd: Path, path: Path | None, environment: dict[str, str]
) -> None:
    for number, file in enumerate(files, start=1):
        os.dup2(os.open(file, os.O_WRONLY | os.O_CREAT), number)
    sys.stdout, sys.stderr = (open(number, "w", encoding="utf-8", closefd=False) for number in (1, 2))  # noqa: SIM115
    os.environ.clear()
    os.environ.update(environment)
    os.chdir(cwd)
    if path is not None:
        sys.path.insert(0, str(path))
    sys.argv = ["scex-sumo", *words]
    from scex_sumo.__main__ import start

    start()
