"""``scex-sumo run``: from a map and a moment to a result folder."""

from __future__ import annotations

import math
import shlex
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from scex_sumo.commands.console import progress_bar, warn
from scex_sumo.commands.seed import SeedRequest, seed_scene
from scex_sumo.errors import UsageError

if TYPE_CHECKING:
    from scex_sumo.extrapolation.workers import Workers
    from scex_sumo.results.run import Run
    from scex_sumo.scene import SeedScene


@dataclass(frozen=True, kw_only=True)
class RunRequest(SeedRequest):
    """The options of ``scex-sumo run`` as given; see its help."""

    children: str | None
    steps: int
    replan: int
    models: str | None
    assign: tuple[str, ...]
    under_test: tuple[str, ...]
    baseline: bool
    thresholds: tuple[str, ...]
    design: str | None
    until_band: float | None
    workers: int
    batch: int | None
    gui: bool
    plots: bool
    overwrite: bool
    keep_plans: bool
    out: Path | None


def run_command(request: RunRequest) -> None:
    """Run, print the summary, say where the result is."""
    from scex_sumo.extrapolation.workers import Workers

    if request.workers < 1:
        raise UsageError(f"--workers: got {request.workers}, needs at least 1")
    with Workers(_processes(request)) as workers:  # they start while this process imports and reads
        scene, out, run = _run(request, workers)
    _tell(request, scene, out, run)


def _processes(request: RunRequest) -> int:
    """How many processes can be of use."""
    if request.gui:
        return 1
    children = request.children or ""
    return min(request.workers, max(int(children), 1)) if children.isdecimal() else request.workers


def _run(request: RunRequest, workers: Workers) -> tuple[SeedScene, Path, Run]:
    from scex_sumo.behaviors.registry import DEFAULT_MODELS
    from scex_sumo.extrapolation.extrapolate import DEFAULT_CHILDREN, extrapolate
    from scex_sumo.statistics.bands import MOST_CHILDREN
    from scex_sumo.statistics.designs import DEFAULT_DESIGN

    assign = parse_assign(request.assign)
    under_test = parse_under_test(request.under_test)
    thresholds = parse_thresholds(request.thresholds)
    scene = seed_scene(request)
    out = request.out if request.out is not None else Path("out") / scene.name
    with progress_bar(f"{scene.name}") as tick:
        try:
            run = extrapolate(
                scene,
                models=request.models if request.models is not None else DEFAULT_MODELS,
                children=request.children or (MOST_CHILDREN if request.until_band else DEFAULT_CHILDREN),
                assign=assign,
                under_test=under_test,
                baseline=request.baseline,
                thresholds=thresholds,
                steps=request.steps,
                replan=request.replan,
                design=request.design if request.design is not None else DEFAULT_DESIGN,
                until_band=request.until_band,
                seed=request.seed,
                workers=workers,
                batch=request.batch,
                out=out,
                overwrite=request.overwrite,
                keep_plans=request.keep_plans,
                gui=request.gui,
                command=["scex-sumo", *sys.argv[1:]],
                progress=tick,
            )
        except KeyboardInterrupt:
            print(
                f"interrupted; finished children are kept in {out}, the same command goes on", file=sys.stderr
            )
            raise SystemExit(130) from None
    return scene, out, run


def _tell(request: RunRequest, scene: SeedScene, out: Path, run: Run) -> None:
    from rich.console import Console

    from scex_sumo.reports.run_table import print_summary

    warn([*run.info["net_notes"], *run.info["run_notes"]])
    print_summary(run, Console(width=None if sys.stdout.isatty() else 110))
    if request.until_band is not None:
        _print_band(run.info["band"])
    tested = run.baseline is not None
    if tested:
        from scex_sumo.reports.under_test_table import print_under_test

        print_under_test(run.under_test, Console(width=None if sys.stdout.isatty() else 110))
    print(f"result: {out}")
    if request.plots:
        from scex_sumo.commands.view import write_critical
        from scex_sumo.reports.page.report import write_report

        write_critical(run)
        print(f"report: {write_report(run, scene)}")
        if tested:
            from scex_sumo.reports.under_test_picture import draw_under_test

            print(f"under test: {draw_under_test(run, run.folder / 'under_test')[-1]}")
    print(f"look:   scex-sumo view {shlex.quote(str(out))} {_which_child(run)}")


def _which_child(run: Run) -> str:
    """The option of ``view`` that shows the child most worth a look; any, where no metric is defined."""
    defined = [column for column in ("ttc", "wttc") if len(run.samples(column))]
    return f"--critical {defined[0]}" if defined else "--child 0"


def _print_band(band: dict[str, Any]) -> None:
    """How surely the distributions are known after a run until a band."""
    left_out = f"; defined too rarely to count: {', '.join(band['left_out'])}" if band["left_out"] else ""
    short = "" if band["width"] <= band["asked"] else f", not the +-{band['asked']:g} asked for"
    print(
        f"widest 95 % band: +-{band['width']:.3f} ({band['metric'] or 'no metric'}) "
        f"after {band['children']} children{short}{left_out}"
    )


def parse_assign(entries: tuple[str, ...], option: str = "--assign") -> dict[int, str]:
    """``TRACK=MODEL`` entries as a mapping.

    Args:
        entries: as given.
        option: what they were given to, for messages.

    Raises:
        UsageError: an entry is not of that form, or names a vehicle again.
    """
    result: dict[int, str] = {}
    for entry in entries:
        track, equals, model = entry.partition("=")
        if not equals or not model or not track.strip().lstrip("-").isdigit():
            raise UsageError(f"{option} {entry}: needs TRACK=MODEL, e.g. {option} 17=emergency_brake")
        if int(track) in result:
            raise UsageError(f"{option} {entry}: vehicle {int(track)} is given twice; give it one model")
        result[int(track)] = model
    return result


def parse_under_test(entries: tuple[str, ...]) -> dict[int, str | None]:
    """``TRACK=MODEL`` entries, or ``TRACK`` alone for a vehicle that is driven as drawn, as a mapping.

    Raises:
        UsageError: an entry is not of that form, or names a vehicle again.
    """
    alone = [entry for entry in entries if entry.strip().isdigit()]
    models = parse_assign(tuple(entry for entry in entries if entry not in alone), "--under-test")
    for entry in alone:
        if int(entry) in models:
            raise UsageError(f"--under-test {entry}: vehicle {int(entry)} is given twice; give it once")
    return {**models, **{int(entry): None for entry in alone}}


def parse_thresholds(entries: tuple[str, ...]) -> dict[str, float]:
    """``METRIC=VALUE`` entries as a mapping.

    Raises:
        UsageError: an entry is not of that form, or names no metric column.
    """
    from scex_sumo.metrics.registry import COLUMNS

    result = {}
    for entry in entries:
        column, _, value = entry.partition("=")
        try:
            result[column] = float(value)
        except ValueError:
            raise UsageError(f"--threshold {entry}: needs METRIC=VALUE, e.g. --threshold ttc=0.5") from None
        if column not in COLUMNS:
            raise UsageError(f"--threshold {entry}: unknown metric {column!r}; known: {', '.join(COLUMNS)}")
        if not math.isfinite(result[column]):
            raise UsageError(f"--threshold {entry}: {value} is no threshold; give a number")
    return result
