"""From a dataset to a ranking of its moments."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa

from scex_sumo.behaviors.registry import DEFAULT_MODELS
from scex_sumo.converters.datasets.recordings import find_recordings
from scex_sumo.errors import UsageError
from scex_sumo.extrapolation.models import ModelSet
from scex_sumo.extrapolation.settings import Models, RunSettings
from scex_sumo.metrics.evaluate import COLUMNS
from scex_sumo.ranking.folder import RankFolder
from scex_sumo.ranking.output import count, describe, write
from scex_sumo.ranking.progress import Campaign, Progress
from scex_sumo.ranking.rounds import FIRST_CHILDREN
from scex_sumo.ranking.task import KEEP, Settings
from scex_sumo.ranking.tasks import Plan
from scex_sumo.ranking.workers import Crew, Processes
from scex_sumo.results.provenance import versions
from scex_sumo.statistics.density import THRESHOLDS
from scex_sumo.statistics.designs import DEFAULT_DESIGN
from scex_sumo.version import __version__

DEFAULT_EVERY_S = 1.0
DEFAULT_CHILDREN = 96
DEFAULT_MIN_VEHICLES = 2
DEFAULT_TOP = 10
MAX_REPLAN = 30  # models plan at least 30 steps


@dataclass(frozen=True, kw_only=True, eq=False)
class Ranking:
    """A finished ranking.

    Attributes:
        folder: where it is.
        table: one row for each seed, see `scex_sumo.ranking.table.schema`; failed ones at the end.
        info: what ``rank.json`` says.
    """

    folder: Path
    table: pa.Table
    info: Mapping[str, Any]


def rank(
    roots: str | Path | Sequence[str | Path],
    *,
    out: str | Path,
    every: float = DEFAULT_EVERY_S,
    children: int = DEFAULT_CHILDREN,
    first: int = FIRST_CHILDREN,
    models: Models = DEFAULT_MODELS,
    min_vehicles: int = DEFAULT_MIN_VEHICLES,
    steps: int = 30,
    replan: int = 5,
    seed: int = 0,
    top: int = DEFAULT_TOP,
    keep: str = "none",
    thresholds: Mapping[str, float] | None = None,
    workers: int = 1,
    cluster: str | None = None,
    overwrite: bool = False,
    command: Sequence[str] | None = None,
    progress: Progress | None = None,
) -> Ranking:
    """Run every moment of a dataset a few times, the promising ones more often, and rank them.

    Args:
        roots: folders of recordings, or single files, as `find_recordings` takes them.
        out: folder of the ranking; an interrupted one goes on.
        every: least time between two seeds of a recording, s; of a file of cases every case is a seed.
        children: children of a seed at most.
        first: children that every seed gets.
        models: behaviour models to draw from.
        min_vehicles: fewer moving vehicles make no seed.
        steps: steps of 0.1 s per child.
        replan: steps that a plan is followed.
        seed: the same seed gives the same ranking.
        top: moments on the page, and those whose places are made sure of.
        keep: whose tracks are kept: ``none``, ``critical`` (at most 5 of a seed) or ``all``.
        thresholds: by metric column, on top of the defaults.
        workers: processes of this machine.
        cluster: address of a Dask scheduler, whose workers are used instead.
        overwrite: replace another ranking in ``out``.
        command: the command line, for ``rank.json``.
        progress: called with (children done, children in all as far as known).

    Returns:
        The ranking. It depends on neither ``workers`` nor ``cluster``, nor on interruptions.

    Raises:
        UsageError: an argument that makes no sense.
        TrackError: no recordings, or no seed in them.
        ResultError: the folder cannot be written or holds something else.
    """
    started = time.perf_counter()
    built = ModelSet.of(RunSettings(models=models))
    settings = Settings(
        models=_written(built),
        weights=tuple(sorted(built.weights.items())),
        steps=steps,
        replan=replan,
        design=DEFAULT_DESIGN,
        seed=seed,
        thresholds=_limits(thresholds or {}),
        keep=keep,
    )
    plan = Plan(
        recordings=find_recordings([roots] if isinstance(roots, str | Path) else roots),
        every_s=every,
        min_vehicles=min_vehicles,
        first=min(first, children),
        children=children,
        top=top,
        settings=settings,
    )
    _check(plan, workers)
    with (
        RankFolder(Path(out), describe(plan), overwrite=overwrite) as folder,
        _crew(workers, cluster) as crew,
    ):
        notes = crew.notes
        campaign = Campaign(plan, folder, crew, progress)
        campaign.run()
        table, shown = write(plan, folder.path, campaign)
        info = {
            "scex_sumo": __version__,
            "command": list(command) if command else None,
            **describe(plan),
            **count(campaign, table),
            "shown": shown,
            "notes": notes,
            "versions": versions(),
            "seconds": round(time.perf_counter() - started, 1),
        }
        folder.finish(info)
    return Ranking(folder=Path(out), table=table, info=info)


def _check(plan: Plan, workers: int) -> None:
    settings = plan.settings
    if not plan.every_s > 0:
        raise UsageError(f"--every: got {plan.every_s:g}, needs seconds above 0")
    at_least_one = {
        "--children": plan.children,
        "--first": plan.first,
        "--min-vehicles": plan.min_vehicles,
        "--top": plan.top,
        "--workers": workers,
        "--steps": settings.steps,
    }
    for name, value in at_least_one.items():
        if value < 1:
            raise UsageError(f"{name}: got {value}, needs at least 1")
    if settings.seed < 0:
        raise UsageError(f"--seed: got {settings.seed}, needs 0 or more")
    if not 1 <= settings.replan <= MAX_REPLAN:
        raise UsageError(f"--replan: got {settings.replan}, needs 1 to {MAX_REPLAN}")
    if settings.keep not in KEEP:
        raise UsageError(f"--keep: got {settings.keep!r}; known: {', '.join(KEEP)}")


def _limits(thresholds: Mapping[str, float]) -> tuple[tuple[str, float], ...]:
    """All thresholds, in the order of the columns."""
    unknown = sorted(set(thresholds) - set(COLUMNS))
    if unknown:
        raise UsageError(f"--threshold: unknown metric {unknown[0]!r}; known: {', '.join(COLUMNS)}")
    limits = {**THRESHOLDS, **thresholds}
    return tuple((column, limits[column]) for column in COLUMNS if column in limits)


def _written(models: ModelSet) -> tuple[str, ...]:
    """The models to draw from as on the command line."""
    return tuple(f"{s}@{s.weight!r}" if s.weight != 1 else str(s) for s in models.drawn)


@contextmanager
def _crew(workers: int, cluster: str | None) -> Iterator[Crew]:
    """The workers, ended in the end."""
    crew: Crew
    if cluster is None:
        crew = Processes(workers)
    else:
        from scex_sumo.ranking.dask_workers import Cluster

        crew = Cluster(cluster)
    try:
        yield crew
    finally:
        crew.close()
