"""Extrapolation of a seed scene in Python: all that ``scex-sumo run`` does."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, TypedDict, cast

from scex_sumo.base.arguments import check_argument
from scex_sumo.base.errors import ScexError, UsageError, warn_notes
from scex_sumo.base.options import split_options
from scex_sumo.base.progress import Progress, progress_of
from scex_sumo.extrapolation.options import RUN_OPTIONS, RunOptions
from scex_sumo.extrapolation.processes.workers import Workers
from scex_sumo.extrapolation.settings import RunSettings
from scex_sumo.results.run import Run
from scex_sumo.scene import SeedScene
from scex_sumo.steps.moment import run_moment
from scex_sumo.world.session import one_at_a_time

if TYPE_CHECKING:
    from pathlib import Path

    from typing_extensions import Unpack

    from scex_sumo.extrapolation.settings import Driver, Models
    from scex_sumo.metrics.registry import Metric
    from scex_sumo.results.region import Region


class RunKeywords(TypedDict, total=False):
    """Options of a run for editors and type checkers, all optional; see `RunSettings`, `RunOptions`."""

    futures: int | str
    steps: int
    replan: int
    models: Models
    assign: Mapping[Any, Driver]
    under_test: Mapping[Any, Driver | None]
    region: Region | str | int | None
    metrics: str | Sequence[str | Metric]
    thresholds: Mapping[str, float]
    seed: int
    world: str
    vru: str
    rules: bool
    workers: int | str | None
    gui: bool
    extra: Sequence[Any]
    overwrite: bool
    out: str | Path | None
    cache: bool
    reference: str | None
    report: bool


def extrapolate(
    scene: SeedScene,
    settings: RunSettings | None = None,
    *,
    progress: Progress | bool | None = None,
    **options: Unpack[RunKeywords],
) -> Run:
    """Simulate many futures of a seed scene with different drivers, and measure each.

    Notes on net and run are `ScexWarning`. Threads of one process wait for each other.

    Args:
        scene: the seed scene, with its road.
        settings: None makes them of the options.
        progress: True for a bar on a terminal or in a notebook; or called with (steps done, steps in all).
        options: fields of `RunSettings` and `RunOptions`, as ``scex-sumo run --help`` lists them, e.g.
            ``futures``, ``models``, ``assign``, ``out``, ``reference``.

    Raises:
        UsageError: an option makes no sense.
        ResultError: the folder cannot be written, or holds another run.
        ScexError: any other fault of the input or the environment.

    Example:
        >>> scene = scex.read_seed(scex.example_path("roundabout"))
        >>> run = scex.extrapolate(scene, futures=4, models="standard_driver,emergency_brake", seed=1)
        >>> run.metrics.num_rows
        4
    """
    try:
        run = _run(scene, settings, progress, cast("dict[str, Any]", options))
    except ScexError as error:
        error.args = (_python_message(str(error)),)
        raise
    warn_notes([*run.info["net_notes"], *run.info["run_notes"]])
    return run


def _run(
    scene: SeedScene, settings: RunSettings | None, progress: Progress | bool | None, options: dict[str, Any]
) -> Run:
    if not isinstance(scene, SeedScene):
        raise UsageError(
            f"extrapolate: got {type(scene).__name__}, needs a seed scene; make one with "
            "scex_sumo.read_seed(map, tracks=...) or synthetic_seed(map, vehicles=...)"
        )
    check_argument("settings", settings, "RunSettings | None")
    check_argument("progress", progress, "Progress | bool | None")
    if "children" in options:  # the former name
        options["futures"] = options.pop("children")
    values, others = split_options(options, RUN_OPTIONS)
    types = {field.name: str(field.type) for kind in RUN_OPTIONS for field in dataclasses.fields(kind)}
    for name, value in options.items():
        check_argument(name, value, types[name])
    settings = RunSettings(**values) if settings is None else dataclasses.replace(settings, **values)
    how = RunOptions(bar=partial(progress_of, progress), **others)
    with one_at_a_time, Workers(how.processes(settings)) as pool:
        return run_moment(scene, settings, workers=pool, options=how)


def _python_message(message: str) -> str:
    """Return a message with arguments in the place of options of the command line, e.g. ``under_test``."""
    words = {"-o": "out", "--overwrite": "overwrite=True", "--no-report": "report=False"}
    words["--threshold"] = "thresholds"
    return re.sub(
        r"(?<![\w-])--?[a-z][a-z-]*(?![\w-])",
        lambda option: words.get(option[0]) or option[0].removeprefix("--").replace("-", "_"),
        message,
    )
