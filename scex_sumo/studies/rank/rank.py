"""Rank the encounters of a dataset, from its recordings to the folder with tables and page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv as pa_csv
import pyarrow.parquet as pq

from scex_sumo.base.arguments import checked
from scex_sumo.base.errors import TrackError, UsageError
from scex_sumo.base.files import replacing
from scex_sumo.base.progress import Progress, progress_of
from scex_sumo.converters.datasets.find import find_recordings, left_out
from scex_sumo.converters.registries import Window
from scex_sumo.decision.moment import FUTURES as HUMAN_FUTURES
from scex_sumo.extrapolation.job import ruled
from scex_sumo.extrapolation.settings import RunSettings
from scex_sumo.results.tables.columns import schema
from scex_sumo.results.tables.pairs import any_of
from scex_sumo.scene import SeedScene
from scex_sumo.studies.moments.encounters import Pairs, encounters_of, pairs_of_moment
from scex_sumo.studies.moments.folder import SEEDS, MomentRef, StudyFolder, as_row
from scex_sumo.studies.moments.run import MomentTask, MomentWorkers, StudySettings, net_of
from scex_sumo.studies.moments.study import MIN_VEHICLES, MomentRun
from scex_sumo.studies.rank.encounters import RANKED, ranked, read_triage
from scex_sumo.studies.rank.page import REPORTS, write_ranking_page


@dataclass(frozen=True, kw_only=True, eq=False)
class Ranking:
    """A finished ranking.

    Attributes:
        table: one row for each encounter, see `scex_sumo.studies.rank.encounters`; doubtful ones last.
        moments: one row for each moment, see `MOMENTS`; failures last.
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


def run_moment(task: MomentTask, scene: SeedScene) -> pa.Table:
    """Return the pairs of a moment."""
    scene, net = ruled(scene, net_of(task.road), task.settings.run)
    return pairs_of_moment(scene, net, futures=HUMAN_FUTURES, seed=task.settings.run.seed)


class RankFolder(StudyFolder):
    """Folder of a ranking under way: ``pairs/location=L/seed=S/pairs.parquet``."""

    info, what = "rank.json", "ranking"
    another = "another ranking, of other recordings or with other options"
    evidence = ("ranking.parquet", "ranking.csv", SEEDS)
    place = "pairs/location={ref.location}/seed={ref.moment}"
    kept = ("ranking.parquet", "ranking.csv", "moments.parquet", "moments.csv", "ranking.html", REPORTS)

    def _tables(self, result: pa.Table) -> Mapping[str, pa.Table]:
        return {"pairs": result}

    def pairs(self, ref: MomentRef) -> pa.Table:
        """Read the pairs of a moment."""
        return self._read(ref, "pairs")


MOMENTS: Final = schema("seed location recording case time_s human_p_collision vehicles failure")
"""Columns of ``moments.parquet``."""


def moments_table(run: MomentRun, pairs: Pairs) -> pa.Table:
    """Return the moments of a ranking by P of any contact, largest first; then those that failed."""
    failed = [*run.unreadable.values(), *(failure for _, failure in sorted(run.failures.items()))]
    if not pairs:
        reason = f"; the first of {len(failed)} failures: {failed[0].reason}" if failed else ""
        raise TrackError(
            f"none of {len(run.recordings)} recordings has a moment with {MIN_VEHICLES} moving "
            f"vehicles that could be run{reason}; lower --every, or look at the recordings"
        )
    rows = []
    for ref, table in pairs:  # P of a contact of any pair whose data are not doubtful
        sure = table.filter(pc.is_null(table["doubt"]))["probability"].to_pylist()
        rows.append(as_row(ref) | {"human_p_collision": any_of(sure)})
    rows.sort(key=lambda moment: (-moment["human_p_collision"], moment["seed"]))
    rows += [as_row(failure) | {"failure": failure.reason} for failure in failed]
    return pa.Table.from_pylist(rows, schema=MOMENTS)


def write_table(path: Path, table: pa.Table) -> None:
    """Write a table as Parquet and CSV, by a path without suffix."""
    with replacing(path.with_name(f"{path.name}.parquet")) as file:
        pq.write_table(table, file, compression="zstd")
    with replacing(path.with_name(f"{path.name}.csv")) as file:
        pa_csv.write_csv(table, file)


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
        MomentWorkers(workers) as pool,
        RankFolder(Path(out), identity, overwrite=overwrite) as folder,
        progress_of(progress, "rank") as tick,
    ):
        ranking = MomentRun(recordings, settings, folder, pool, tick)
        ranking.run(run_moment)
        pairs = [(ref, folder.pairs(ref)) for ref in ranking.refs]
        moments = moments_table(ranking, pairs)
        encounters = ranked(encounters_of(pairs, every), verdicts, by)
        table, about, notes = write_ranking_page(ranking, pairs, encounters, top, by)
        for name, content in (("moments", moments), ("ranking", table)):
            write_table(folder.path / name, content)
        info = {
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
        }
        info = folder.finished(info, command)
    return Ranking(folder=Path(out), table=table, moments=moments, info=info)
