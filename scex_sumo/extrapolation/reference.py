"""Reference of a run: what the same seed scene likely becomes, beside what it could become."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from typing import Any

from scex_sumo.extrapolation.extrapolate import Progress, extrapolate
from scex_sumo.extrapolation.workers.pool import Workers
from scex_sumo.results.run import REFERENCE, Run
from scex_sumo.scene import SeedScene

CHILDREN = 117
"""Children of a reference: a 95 % interval of at most +-9 % around a share."""
STEPS = 30
"""Steps of a child at which all of these are run, however few children the run itself has."""

SHARED = ("steps", "replan", "seed", "preset", "metrics", "thresholds", "reflect")
"""Settings that a reference has from its run; it draws all its vehicles, none is assigned or under test."""


def add_reference(
    run: Run,
    scene: SeedScene,
    mix: str,
    *,
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
        mix: the models that tell what is likely, as `extrapolate` takes them.
        workers: as in `extrapolate`.
        cache: likewise.
        progress: likewise.
        command: likewise.
        settings: those of the run; only `SHARED` are taken.

    Returns:
        The reference.
    """
    shared = {name: value for name, value in settings.items() if name in SHARED}
    return extrapolate(
        scene,
        out=run.folder / REFERENCE,
        overwrite=True,
        workers=workers,
        cache=cache,
        progress=progress,
        command=command,
        models=mix,
        children=reference_children(run.children, run.info["steps"]),
        keep_plans=False,
        world="plain" if settings.get("world") == "plain" else "checked",
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
