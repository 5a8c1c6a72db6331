"""What a ranking says of itself, and what it writes when all seeds have run."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc

from scex_sumo.converters.datasets.recordings import Recording
from scex_sumo.errors import TrackError
from scex_sumo.ranking.page import write_page
from scex_sumo.ranking.progress import Campaign
from scex_sumo.ranking.table import failed_row, placed, seed_row, tabulate, write_ranking
from scex_sumo.ranking.tasks import Plan
from scex_sumo.version import __version__


def describe(plan: Plan) -> dict[str, Any]:
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


def write(plan: Plan, folder: Path, campaign: Campaign) -> tuple[pa.Table, list[str]]:
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
    write_ranking(folder, table)
    return table, write_page(plan, folder, campaign, table)


def count(campaign: Campaign, table: pa.Table) -> dict[str, int]:
    """How many seeds, failures, children and plans that are not the models' own."""
    seeds = len(campaign.refs)
    return {
        "seeds": seeds,
        "failed": len(table) - seeds,
        "children_run": pc.sum(table["children"]).as_py(),
        "fallbacks": pc.sum(table["fallbacks"]).as_py() or 0,
    }
