"""Command line and scripts in a process that starts in milliseconds, forked off a server with the package.

Tests of the start itself, of signals and of limits start Python anew.
"""

from __future__ import annotations

import gc
import multiprocessing
import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from multiprocessing.context import ForkServerContext
from pathlib import Path
from types import ModuleType
from unittest import mock

PRELOADED = (
    "libsumo",
    "matplotlib.backends.backend_agg",
    "matplotlib.figure",
    "scex_sumo.cli",
    "scex_sumo.steps.seed",
    "scex_sumo.converters.datasets.recordings",
    "scex_sumo.converters.lanelet.reader",
    "scex_sumo.extrapolation.engine",
    "scex_sumo.converters.cleaning.align",
    "scex_sumo.converters.cleaning.plausibility",
    "scex_sumo.converters.cleaning.repair",
    "scex_sumo.formats.lane_maps.lane_map",
    "scex_sumo.humans.driver",
    "scex_sumo.steps.moment",
    "scex_sumo.lanelet2sumo.net",
    "scex_sumo.page.report.report",
    "scex_sumo.reports.run_table",
    "scex_sumo.scenarios.seeds",
    "scex_sumo.studies.rank.rank",
    "scex_sumo.world.plain",
    "scex_sumo.world.sumo",
    "tests.command",
    "tests.workers",
)
# Options of a run that leave out what costs more than a few futures.
ALONE = ("--reference", "none")


def forkserver() -> ForkServerContext:
    """Return what forks processes off the server of this process."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(list(PRELOADED))
    return context


class Started:
    """A command that runs: `wait` for its end, or `kill` it."""

    def __init__(
        self,
        words: list[str],
        cwd: Path | None = None,
        path: Path | None = None,
        env: Mapping[str, str] | None = None,
        vehicles: int | None = None,
        code: str | None = None,
    ) -> None:
        self._words, self._folder = words, tempfile.TemporaryDirectory()
        self._files = [Path(self._folder.name, name) for name in ("stdout", "stderr")]
        environment = dict(os.environ if env is None else env)
        given = (words, self._files, cwd or Path.cwd(), path, environment, vehicles, code)
        self._process = forkserver().Process(target=_run, args=given)
        self._process.start()
        self.kill = self._process.kill

    def wait(self, timeout: float = 120.0) -> subprocess.CompletedProcess[str]:
        """Return its status and what it printed; killed after ``timeout`` in s, it fails the test."""
        with self._folder:
            self._process.join(timeout)
            if self._process.is_alive():
                self._process.kill()
                raise subprocess.TimeoutExpired(self._words, timeout)
            out, errors = (f.read_text(encoding="utf-8") if f.exists() else "" for f in self._files)
        assert self._process.exitcode is not None
        return subprocess.CompletedProcess(self._words, self._process.exitcode, out, errors)


def started(
    *arguments: object,
    cwd: Path | None = None,
    path: Path | None = None,
    env: Mapping[str, str] | None = None,
    vehicles: int | None = None,
) -> Started:
    """Start ``scex-sumo`` as its console script does.

    Args:
        cwd: folder in which it runs.
        path: folder from which it also imports.
        env: its environment; without it, that of the test.
        vehicles: of a batch of futures, at most.
    """
    return Started([*map(str, arguments)], cwd, path, env, vehicles)


def scex(
    *arguments: object,
    cwd: Path | None = None,
    path: Path | None = None,
    env: Mapping[str, str] | None = None,
    vehicles: int | None = None,
    timeout: float = 120.0,
) -> subprocess.CompletedProcess[str]:
    """Run ``scex-sumo`` to its end; see `started` and `Started.wait`."""
    return started(*arguments, cwd=cwd, path=path, env=env, vehicles=vehicles).wait(timeout)


def status(*arguments: object) -> int:
    """Run ``scex-sumo`` in this process and return its status; what it prints pytest may capture."""
    from scex_sumo.cli import main

    with mock.patch.object(sys, "argv", ["scex-sumo", *map(str, arguments)]):
        try:
            main()
        except SystemExit as stop:
            return int(stop.code or 0)
    return 0


def script(
    code: str, *arguments: object, cwd: Path | None = None, env: Mapping[str, str] | None = None
) -> subprocess.CompletedProcess[str]:
    """Run Python code to its end as ``python -c`` does; its workers are those of the package."""
    return Started([*map(str, arguments)], cwd, env=env, code=code).wait()


def _run(
    words: list[str],
    files: list[Path],
    cwd: Path,
    path: Path | None,
    environment: dict[str, str],
    vehicles: int | None,
    code: str | None,
) -> None:
    gc.freeze()  # what was imported before stays
    for number, file in enumerate(files, start=1):
        os.dup2(os.open(file, os.O_WRONLY | os.O_CREAT), number)
    sys.stdout, sys.stderr = (open(number, "w", encoding="utf-8", closefd=False) for number in (1, 2))  # noqa: SIM115
    os.environ.clear()
    os.environ.update(environment)
    os.chdir(cwd)
    tempfile.tempdir = None  # as the environment says
    if code is not None:
        sys.argv, sys.modules["__main__"] = ["-c", *words], ModuleType("__main__")
        sys.path.insert(0, "")
        exec(compile(code, "<string>", "exec"), vars(sys.modules["__main__"]))
        return
    if path is not None:
        sys.path.insert(0, str(path))
    sys.argv = ["scex-sumo", *words]
    from scex_sumo.__main__ import start
    from scex_sumo.extrapolation import job
    from tests.workers import forked_workers

    if vehicles is not None:
        job.VEHICLES_AT_ONCE = vehicles
    with forked_workers(multiprocessing.get_context("fork")):
        start()
