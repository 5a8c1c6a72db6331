"""Reference of a run: what the same seed scene likely becomes, beside what it could become."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from concurrent.futures import Future
from functools import partial
from pathlib import Path
from typing import Any

from scex_sumo.extrapolation.extrapolate import SETTINGS, Progress, extrapolate
from scex_sumo.extrapolation.workers.pool import Workers, ended_well
from scex_sumo.results.run import REFERENCE, Run
from scex_sumo.scene import SeedScene

CHILDREN = 117
"""Children of a reference: a 95 % interval of at most +-9 % around a share."""
STEPS = 30
"""Steps of a child at which all of these are run, however few children the run itself has."""

SHARED = ("steps", "replan", "seed", "preset", "metrics", "thresholds", "reflect")
"""Settings that a reference has from its run; it draws all its vehicles, none is assigned or under test."""


def begin_reference(
    folder: Path, children: int, scene: SeedScene, mix: str, /, *, workers: Workers, **options: Any
) -> Future[Any] | None:
    """Have a worker run the reference of a run while that one begins.

    Args:
        folder: of the run.
        children: of the run.
        scene: its seed scene, with its road.
        mix: the models that tell what is likely.
        workers: one of them does it, if that takes it no longer than the children take the others.
        options: the others of `add_reference`, but for ``progress``.

    Returns:
        For `add_reference`; None where nothing has begun.
    """
    if children < CHILDREN * (workers.processes - 1):
        return None
    return workers.beside(partial(_run, folder, children, scene, mix, **options), where="over the reference")


def add_reference(
    run: Run,
    scene: SeedScene,
    mix: str,
    *,
    begun: Future[Any] | None = None,
    workers: int | Workers = 1,
    cache: bool = True,
    progress: Progress | None = None,
    command: Sequence[str] | None = None,
    **settings: Any,
) -> Run:
    """Run the reference of a run into its folder, ``reference/``, a result by itself; what is there is kept.

    Args:
        run: the finished run, whose children stay as they are.
        scene: its seed scene, with its road.
        begun: what `begin_reference` gave.
        mix: the models that tell what is likely, as `extrapolate` takes them.
        workers: as in `extrapolate`.
        cache: likewise.
        progress: likewise.
        command: likewise.
        settings: those of the run; only `SHARED` are taken.

    Returns:
        The reference.
    """
    if begun is None or not ended_well(begun):
        options = {"cache": cache, "progress": progress, "command": command}
        _run(run.folder, run.children, scene, mix, workers=workers, **options, **settings)
    return Run(run.folder / REFERENCE)


def _run(folder: Path, children: int, scene: SeedScene, mix: str, /, **options: Any) -> None:
    """Run the reference of a run of so many children; options of `extrapolate`, and settings of the run."""
    shared = {name: value for name, value in options.items() if name not in SETTINGS or name in SHARED}
    extrapolate(
        scene,
        out=folder / REFERENCE,
        overwrite=True,
        models=mix,
        children=reference_children(children, options.get("steps", STEPS)),
        keep_plans=False,
        world="plain" if options.get("world") == "plain" else "checked",
        **shared,
    )


def reference_children(children: int, steps: int) -> int:
    """Children of a reference: fewer where they would cost more than the run and than `STEPS` steps of all.

    Args:
        children: of the run.
        steps: of a child.
    """
    return min(CHILDREN, max(children, CHILDREN * STEPS // steps))


def drop_reference(run: Run) -> None:
    """Remove the reference of an earlier run from a result folder, where there is one."""
    shutil.rmtree(run.folder / REFERENCE, ignore_errors=True)
