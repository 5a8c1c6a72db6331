"""Ranking of a dataset: from its recordings to the folder with table and page."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc

from scex_sumo.converters.datasets.recordings import find_recordings
from scex_sumo.ranking.folder import RankFolder
from scex_sumo.ranking.page import write_ranking_page
from scex_sumo.ranking.ranking_run import Progress, RankingRun
from scex_sumo.ranking.settings import RankSettings
from scex_sumo.ranking.table import ranking_table, write_ranking
from scex_sumo.ranking.workers import DaskWorkers, LocalWorkers, MomentWorkers
from scex_sumo.results.provenance import versions
from scex_sumo.version import __version__


@dataclass(frozen=True, kw_only=True, eq=False)
class Ranking:
    """A finished ranking.

    Attributes:
        folder: where it is.
        table: one row for each moment, see `scex_sumo.ranking.table.schema`; failed ones at the end.
        info: what ``rank.json`` says.
    """

    folder: Path
    table: pa.Table
    info: Mapping[str, Any]


def rank(
    roots: str | Path | Sequence[str | Path],
    *,
    out: str | Path,
    workers: int = 1,
    cluster: str | None = None,
    overwrite: bool = False,
    command: Sequence[str] | None = None,
    progress: Progress | None = None,
    **settings: Any,
) -> Ranking:
    """Run every moment of a dataset a few times, the promising ones more often, and rank them.

    Args:
        roots: folders of recordings, or single files, as `find_recordings` takes them.
        out: folder of the ranking; an interrupted one goes on.
        workers: processes of this machine.
        cluster: address of a Dask scheduler, whose workers are used instead.
        overwrite: replace another ranking in ``out``.
        command: the command line, for ``rank.json``.
        progress: called with (children done, children in all as far as known).
        settings: see `scex_sumo.ranking.settings.RankSettings`: every, children, first, models,
            min_vehicles, steps, replan, seed, top, keep, cache, thresholds.

    Returns:
        The ranking. It depends on neither ``workers`` nor ``cluster``, nor on interruptions.

    Raises:
        UsageError: an argument that makes no sense.
        TrackError: no recordings, or no moment in them.
        ResultError: the folder cannot be written or holds something else.
    """
    started = time.perf_counter()
    asked = RankSettings(**settings)
    recordings = find_recordings([roots] if isinstance(roots, str | Path) else roots)
    identity = asked.to_json(recordings)
    at_work: MomentWorkers = LocalWorkers(workers) if cluster is None else DaskWorkers(cluster)
    with closing(at_work), RankFolder(Path(out), identity, overwrite=overwrite) as folder:
        run = RankingRun(recordings, asked, folder, at_work, progress)
        run.run()
        table = ranking_table(run)
        write_ranking(folder.path, table)
        shown = write_ranking_page(run, folder.path, table, workers=workers if cluster is None else 1)
        info = {
            "scex_sumo": __version__,
            "command": list(command) if command else None,
            **identity,
            "seeds": len(run.refs),
            "failed": len(table) - len(run.refs),
            "children_run": pc.sum(table["children"]).as_py(),
            "fallbacks": pc.sum(table["fallbacks"]).as_py() or 0,
            "shown": shown,
            "notes": at_work.notes(),
            "versions": versions(),
            "seconds": round(time.perf_counter() - started, 1),
        }
        folder.finish(info)
    return Ranking(folder=Path(out), table=table, info=info)
