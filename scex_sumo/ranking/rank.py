"""From a dataset to a ranking of its moments."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa

from scex_sumo import __version__
from scex_sumo.behaviors.registry import DEFAULT_MODELS
from scex_sumo.casting import Casting, Models, cast_models, drivers, weights_of
from scex_sumo.converters.recordings import Recording, find_recordings
from scex_sumo.density import THRESHOLDS
from scex_sumo.designs import DEFAULT_DESIGN
from scex_sumo.errors import TrackError, UsageError
from scex_sumo.metrics.evaluate import COLUMNS
from scex_sumo.provenance import versions
from scex_sumo.ranking.campaign import Campaign, Progress
from scex_sumo.ranking.crew import Crew, Processes
from scex_sumo.ranking.cutting import Plan
from scex_sumo.ranking.folder import RankFolder
from scex_sumo.ranking.page import write_page
from scex_sumo.ranking.rounds import FIRST_CHILDREN
from scex_sumo.ranking.table import failed_row, placed, seed_row, tabulate, write_ranking
from scex_sumo.ranking.work import KEEP, Settings

DEFAULT_EVERY_S = 1.0
DEFAULT_CHILDREN = 96
DEFAULT_MIN_VEHICLES = 2
DEFAULT_TOP = 10


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
        roots: folders of recordings, or single files, see `scex_sumo.converters.recordings.find_recordings`.
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
    _check(every, children, first, min_vehicles, seed, top, keep, workers, steps, replan)
    limits = {**THRESHOLDS, **(thresholds or {})}
    casting = cast_models(models, {})
    weights = weights_of(casting, drivers(casting))
    recordings = find_recordings([roots] if isinstance(roots, str | Path) else roots)
    plan = Plan(
        recordings=recordings,
        every_s=every,
        min_vehicles=min_vehicles,
        first=min(first, children),
        children=children,
        top=top,
        settings=Settings(
            models=_written(casting),
            weights=tuple(sorted(weights.items())),
            steps=steps,
            replan=replan,
            design=DEFAULT_DESIGN,
            seed=seed,
            thresholds=tuple((column, limits[column]) for column in COLUMNS if column in limits),
            keep=keep,
        ),
    )
    described = _describe(plan)
    with RankFolder(Path(out), described, overwrite=overwrite) as folder:
        crew: Crew = Processes(workers) if cluster is None else _cluster(cluster)
        try:
            notes = crew.notes
            campaign = Campaign(plan, folder, crew, progress)
            campaign.run()
            table, shown = _write(plan, folder, campaign)
        finally:
            crew.close()
        info = {
            "scex_sumo": __version__,
            "command": list(command) if command else None,
            **described,
            "seeds": len(campaign.refs),
            "failed": len(table) - len(campaign.refs),
            "children_run": sum(t.children for tallies in campaign.tallies.values() for t in tallies),
            "shown": shown,
            "notes": notes,
            "versions": versions(),
            "seconds": round(time.perf_counter() - started, 1),
        }
        folder.finish(info)
    return Ranking(folder=Path(out), table=table, info=info)


def _check(
    every: float,
    children: int,
    first: int,
    min_vehicles: int,
    seed: int,
    top: int,
    keep: str,
    workers: int,
    steps: int,
    replan: int,
) -> None:
    if not every > 0:
        raise UsageError(f"--every: got {every:g}, needs seconds above 0")
    at_least_one = {
        "--children": children,
        "--first": first,
        "--min-vehicles": min_vehicles,
        "--top": top,
        "--workers": workers,
        "--steps": steps,
    }
    for name, value in at_least_one.items():
        if value < 1:
            raise UsageError(f"{name}: got {value}, needs at least 1")
    if seed < 0:
        raise UsageError(f"--seed: got {seed}, needs 0 or more")
    if not 1 <= replan <= 30:
        raise UsageError(f"--replan: got {replan}, needs 1 to 30 (models plan 30 steps)")
    if keep not in KEEP:
        raise UsageError(f"--keep: got {keep!r}; known: {', '.join(KEEP)}")


def _written(casting: Casting) -> tuple[str, ...]:
    """The models to draw from as on the command line."""
    return tuple(f"{s}@{s.weight!r}" if s.weight != 1 else str(s) for s in casting.drawn)


def _cluster(address: str) -> Crew:
    from scex_sumo.ranking.cluster import Cluster

    return Cluster(address)


def _describe(plan: Plan) -> dict[str, Any]:
    """What the result depends on; recordings by name and size, so that a dataset may lie anywhere."""
    settings = plan.settings
    return {
        "recordings": [_described(recording) for recording in plan.recordings],
        "every_s": plan.every_s,
        "min_vehicles": plan.min_vehicles,
        "first": plan.first,
        "children": plan.children,
        "top": plan.top,
        "models": list(settings.models),
        "weights": dict(settings.weights),
        "steps": settings.steps,
        "replan": settings.replan,
        "design": settings.design,
        "seed": settings.seed,
        "thresholds": dict(settings.thresholds),
        "keep": settings.keep,
        "version": __version__,
    }


def _described(recording: Recording) -> dict[str, Any]:
    files = (recording.map_path, *recording.track_paths)
    sizes = [file.stat().st_size if file.exists() else None for file in files]
    return {"name": recording.name, "site": recording.site, "bytes": sizes}


def _write(plan: Plan, folder: RankFolder, campaign: Campaign) -> tuple[pa.Table, list[str]]:
    """Write table and page; returns the table, and the seeds on the page.

    Raises:
        TrackError: no seed at all.
    """
    refs, limits = campaign.refs, dict(plan.settings.thresholds)
    broken = [found.failure for found in campaign.listings.values() if found.failure is not None]
    if not refs:
        failed = [*broken, *campaign.failures.values()]
        reason = f"; the first of {len(failed)} failures: {failed[0].reason}" if failed else ""
        raise TrackError(
            f"none of {len(plan.recordings)} recordings has a moment with {plan.min_vehicles} moving "
            f"vehicles that could be run{reason}; lower --min-vehicles or look at the recordings"
        )
    table = placed(
        tabulate((seed_row(ref, campaign.parts(ref), limits) for ref in refs), limits),
        limits,
        seed=plan.settings.seed,
    )
    known = {ref.seed for ref in refs}
    late = {name: failure.reason for name, failure in campaign.failures.items() if name in known}
    if late:  # they have their first children, but not those that were asked for later
        reasons = pa.array([late.get(name) for name in table["seed"].to_pylist()], pa.string())
        table = table.set_column(table.schema.get_field_index("failure"), "failure", reasons)
    rows = [failed_row(f) for f in broken]
    rows += [failed_row(f) for name, f in sorted(campaign.failures.items()) if name not in known]
    table = pa.concat_tables([table, tabulate(rows, limits)]).combine_chunks()
    write_ranking(folder.path, table)
    return table, write_page(plan, folder.path, campaign, table)
