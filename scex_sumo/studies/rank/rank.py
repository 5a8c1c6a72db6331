"""Rank the encounters of a dataset, from its recordings to the folder with tables and page."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc

from scex_sumo.base.arguments import checked
from scex_sumo.base.errors import UsageError
from scex_sumo.base.progress import Progress, progress_of
from scex_sumo.base.version import __version__
from scex_sumo.converters.datasets.find import find_recordings, left_out
from scex_sumo.converters.registries import Window
from scex_sumo.extrapolation.settings import RunSettings
from scex_sumo.results.info import versions
from scex_sumo.studies.moments.encounters import encounters_of
from scex_sumo.studies.moments.run import MomentWorkers, StudySettings
from scex_sumo.studies.rank.encounters import RANKED, ranked, read_triage
from scex_sumo.studies.rank.page import write_ranking_page
from scex_sumo.studies.rank.ranking_run import RankFolder, RankingRun, moments_table, run_moment, write_table


@dataclass(frozen=True, kw_only=True, eq=False)
class Ranking:
    """A finished ranking.

    Attributes:
        table: one row for each encounter, see `scex_sumo.studies.rank.encounters`; doubtful ones last.
        moments: one row for each moment, see `scex_sumo.studies.rank.ranking_run.MOMENTS`; failures last.
        info: content of ``rank.json``.

    Example:
        >>> ranking = scex.rank(scex.example_path("roundabout"), out="ranked", every=9, futures=2)
        >>> ranking.table["seed"][0].as_py()
        'roundabout_t9.1'
    """

    folder: Path
    table: pa.Table
    moments: pa.Table
    info: Mapping[str, Any]


@checked
def rank(
    roots: str | Path | Sequence[str | Path],
    *,
    out: str | Path,
    workers: int = 1,
    every: float = 1.0,
    window: Window = (None, None),
    futures: int = 96,
    top: int = 10,
    by: str = "probability",
    triage: str | Path | None = None,
    overwrite: bool = False,
    command: Sequence[str] | None = None,
    progress: Progress | bool | None = None,
    **run: Any,
) -> Ranking:
    """Rank the encounters of a dataset by P of a contact; run the stress test of the moments of the top ones.

    Args:
        roots: folders of recordings, or single files.
        out: folder of the ranking; an interrupted one goes on.
        workers: processes.
        every: as of `StudySettings`.
        futures: of each moment on the page.
        top: encounters on the page.
        by: column by which encounters are ordered.
        triage: file of verdicts that the page of a ranking has saved.
        window: first and last moment, s; None is where a recording begins or ends.
        overwrite: replace another ranking in ``out``.
        command: the command line, for ``rank.json``.
        progress: True for a bar; or called with (moments done, moments expected).
        run: settings as of `extrapolate`.

    Raises:
        UsageError: an argument makes no sense.
        TrackError: no moment can be run.
        ResultError: the folder cannot be written or holds something else.

    Example:
        >>> ranking = scex.rank(scex.example_path("roundabout"), out="ranking", every=9, futures=2)
        >>> ranking.table["rank"][0].as_py()
        1
    """
    started = time.perf_counter()
    settings = StudySettings(run=RunSettings(futures=futures, **run), every=every)
    if top < 1:
        raise UsageError(f"--top: got {top}, needs at least 1")
    ranked(RANKED.empty_table(), by=by)
    verdicts = () if triage is None else read_triage(Path(triage))
    if window[0] is not None and window[1] is not None and window[0] > window[1]:
        raise UsageError(f"--from {window[0]:g} --to {window[1]:g}: ends before it begins")
    places = [roots] if isinstance(roots, str | Path) else roots
    recordings_found = find_recordings(places)
    recordings = tuple(recording.within(window) for recording in recordings_found)
    identity = settings.identity(recordings)
    with (
        closing(MomentWorkers(workers)) as pool,
        RankFolder(Path(out), identity, overwrite=overwrite) as folder,
        progress_of(progress, "rank") as tick,
    ):
        ranking = RankingRun(recordings, settings, folder, pool, tick)
        ranking.run(run_moment)
        moments = moments_table(ranking)
        encounters = ranked(encounters_of(ranking.pairs, every), verdicts, by)
        table, about, notes = write_ranking_page(ranking, encounters, top, by)
        for name, content in (("moments", moments), ("ranking", table)):
            write_table(folder.path / name, content)
        info = {
            "scex_sumo": __version__,
            "command": list(command) if command else None,
            **identity,
            "roots": [str(Path(place).absolute()) for place in places],
            "seeds": len(ranking.refs),
            "failed": len(moments) - len(ranking.refs),
            "encounters": len(table),
            "doubtful": len(table) - table["doubt"].null_count,
            "to_test": pc.sum(table.filter(pc.is_valid(table["rank"]))["to_test"]).as_py() or 0,
            "top": top,
            "by": by,
            **about,
            "notes": [*left_out(places), *pool.deaths, *notes],
            "versions": versions(),
            "seconds": round(time.perf_counter() - started, 1),
        }
        folder.finish(info)
    return Ranking(folder=Path(out), table=table, moments=moments, info=info)
