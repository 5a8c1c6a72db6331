"""Futures of the moments of a ranking: run and measured in a worker, as a table, and kept in its folder."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np
import pyarrow as pa

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.extrapolation.job import Job, ruled, run_in_memory
from scex_sumo.results.folder import tracks_table
from scex_sumo.results.parts import Part
from scex_sumo.scene import SeedScene
from scex_sumo.studies.moments.folder import Failure, Listing, MomentRef, StudyFolder, as_row, from_row
from scex_sumo.studies.moments.pairs import pairs_of_moment
from scex_sumo.studies.moments.run import MomentTask, attempt, built, compared, net_of
from scex_sumo.studies.rank.exact import ExactScore, find_exact_score
from scex_sumo.studies.rank.scores import RankSettings, critical_pairs, score_of

MAX_KEPT = 5
"""Futures of a moment whose tracks ``critical`` keeps at most."""
PAIRS_ROUND = range(0)
"""Futures of the first round: none; it asks for the critical responses of all pairs."""


def is_pairs(span: range) -> bool:
    """Whether it is `PAIRS_ROUND`; other empty rounds search tables after some futures."""
    return not span.stop


@dataclass(frozen=True, kw_only=True, eq=False)
class RankTask(MomentTask):
    """A moment to be ranked: its pairs if it has no futures to be run, else these.

    Attributes:
        spare: how many more futures may have their tracks kept.
        drawn: critical encounters of all drawn futures, for the search of an exact score.
    """

    settings: RankSettings
    spare: int
    drawn: Sequence[IntArray] | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class MomentPart:
    """Measured futures of one moment.

    Attributes:
        futures: one row each, see `futures_schema`.
        tracks: INTERACTION columns of the kept futures; None if none is kept.
    """

    futures: pa.Table
    tracks: pa.Table | None


def run_moment(task: RankTask, road: bytes | None = None) -> pa.Table | MomentPart | ExactScore | Failure:
    """Return the pairs of a moment, or its futures, on its road or the one given; or its failure."""
    return attempt(_run, task, road)


def _run(task: RankTask, scene: SeedScene, road: bytes) -> pa.Table | MomentPart | ExactScore:
    models, run, net = built(task.settings.models), task.settings.run, net_of(road, task.settings.cache)
    scene, net = ruled(scene, net, run)
    if is_pairs(task.futures):
        return pairs_of_moment(scene)
    if task.futures.start == 0:
        models.try_on(scene, seed=run.seed)
    count = task.futures.stop if task.drawn is None else task.settings.futures
    drawn = models.draw(scene, futures=count, seed=run.seed, design=run.design)
    same = compared(net, task.ref)
    job = Job(scene, net, run, models, drawn, net.path.parent, compared=same)
    if task.drawn is not None:
        return find_exact_score(job, task.drawn)
    part = run_in_memory(job, task.futures)
    pairs = critical_pairs(part, scene.track_ids)
    kept = choose_kept(score_of(pairs), task.settings.keep, task.spare)
    table = futures_table(
        part.futures,
        columns=run.columns,
        values=part.values,
        defined=part.defined,
        fallbacks=_fallbacks(part),
        kept=kept,
        track_ids=np.asarray(scene.track_ids, dtype=np.int64),
        models=np.asarray(models.names, dtype=object)[drawn[part.futures]].tolist(),
        pairs=pairs,
    )
    chosen = dataclasses.replace(part, futures=part.futures[kept], states=part.states[kept])
    return MomentPart(futures=table, tracks=tracks_table(scene, chosen) if kept.any() else None)


def _fallbacks(part: Part) -> IntArray:
    if part.fallbacks is None:
        return np.zeros(len(part.futures), dtype=np.int64)
    of_future = np.asarray(part.fallbacks["future"], dtype=np.int64)
    row = np.searchsorted(part.futures, of_future)
    return np.bincount(row, minlength=len(part.futures)).astype(np.int64)


def choose_kept(score: FloatArray, keep: str, spare: int) -> BoolArray:
    """Return whose tracks (C,) are kept: of ``critical`` those of the greatest score above 0."""
    if keep != "critical":
        return np.full(len(score), keep == "all")
    kept = np.zeros(len(score), dtype=bool)
    kept[np.argsort(-score, kind="stable")[:spare]] = True
    return np.asarray(kept & (score > 0), dtype=bool)


def futures_schema(columns: Sequence[str]) -> pa.Schema:
    """Return the columns of a moment's futures; undefined metrics are null.

    ``fallbacks`` counts fallback plans. ``track_id`` and ``model`` have one entry for each vehicle,
    ``critical_pairs`` five for each critical encounter, see `pairs_of`.
    """
    return pa.schema(
        [
            ("future", pa.int32()),
            *((name, pa.float64()) for name in columns),
            ("fallbacks", pa.int32()),
            ("kept", pa.bool_()),
            ("track_id", pa.list_(pa.int64())),
            ("model", pa.list_(pa.string())),
            ("critical_pairs", pa.list_(pa.int64())),
        ]
    )


def futures_table(
    futures: IntArray,
    *,
    columns: Sequence[str],
    values: FloatArray,
    defined: BoolArray,
    fallbacks: IntArray,
    kept: BoolArray,
    track_ids: IntArray,
    models: Sequence[Sequence[str]],
    pairs: Sequence[IntArray],
) -> pa.Table:
    """Return rows of (C,) futures, see `futures_schema`.

    Args:
        values: (C, M) of the metric columns; ``defined`` too.
        models: (C, V), with ``track_ids`` (V,).
        pairs: (C,) of (E, 5), see `pairs_of`.
    """
    metrics = [pa.array(values[:, m], mask=~defined[:, m]) for m in range(len(columns))]
    tracks, drivers = [track_ids.tolist()] * len(futures), [list(row) for row in models]
    critical = [rows.reshape(-1) for rows in pairs]
    data = [futures, *metrics, fallbacks, kept, tracks, drivers, critical]
    schema = futures_schema(columns)
    each = zip(schema.names, data, schema.types, strict=True)
    return pa.table({name: pa.array(one, kind) for name, one, kind in each})


REPORTS = "moments"
"""Folder of the reports of the moments that are shown."""
_PAIRS, _FUTURES, _TRACKS, _SEEDS, _EXACT = "pairs", "futures", "tracks", "seeds", "exact"


class RankFolder(StudyFolder):
    """Folder of a ranking under way: ``pairs/``, ``futures/location=L/seed=S/futures-FIRST-LAST.parquet``."""

    info, what = "rank.json", "ranking"
    another = "another ranking, of other recordings or with other options"
    evidence = ("ranking.parquet", "ranking.csv", _SEEDS)
    trees, records = (_PAIRS, _FUTURES, _TRACKS), (_SEEDS, _EXACT)
    kept = ("ranking.parquet", "ranking.csv", "moments.parquet", "moments.csv", "ranking.html", REPORTS)

    def listing(self, recording: str) -> Listing | None:
        """Return the moments of a recording; None if it is not listed, or the file is damaged."""
        rows = self._load(_SEEDS, recording)
        refs = None if rows is None else tuple(MomentRef(**from_row(row)) for row in rows)
        return None if refs is None else Listing(recording=recording, moments=refs)

    def save_listing(self, listing: Listing) -> None:
        """Keep the moments of a recording."""
        self._save(_SEEDS, listing.recording, [as_row(ref) for ref in listing.moments])

    def exact(self, ref: MomentRef) -> ExactScore | None:
        """Return the exact score of a moment; None if it was not searched, or the file is damaged."""
        rows = self._load(_EXACT, ref.moment)
        return ExactScore(**rows[0]) if rows else None

    def save_exact(self, ref: MomentRef, exact: ExactScore) -> None:
        """Keep the exact score of a moment."""
        self._save(_EXACT, ref.moment, [asdict(exact)])

    def has(self, ref: MomentRef, span: range) -> bool:
        """Whether a part of a moment is there; that of `PAIRS_ROUND` has its pairs."""
        return self._has(ref.moment, _name(span))

    def save_pairs(self, ref: MomentRef, pairs: pa.Table) -> None:
        """Keep the pairs of a moment."""
        file = _file(_PAIRS, ref, PAIRS_ROUND)
        self._add(ref.moment, _PAIRS, {file: pairs}, write_statistics=False, store_schema=False)

    def pairs(self, ref: MomentRef) -> pa.Table:
        """Read the pairs of a moment."""
        return self._read(ref.moment, _PAIRS, _file(_PAIRS, ref, PAIRS_ROUND))

    def append(self, ref: MomentRef, part: MomentPart) -> None:
        """Add futures of a moment, unless they are there."""
        numbers = part.futures["future"]
        span = range(numbers[0].as_py(), numbers[-1].as_py() + 1)
        if self.has(ref, span):
            return
        tables = {_TRACKS: part.tracks, _FUTURES: part.futures}
        files = {_file(kind, ref, span): table for kind, table in tables.items() if table is not None}
        # Of so few rows, statistics and schema would be the larger part.
        self._add(ref.moment, _name(span), files, write_statistics=False, store_schema=False)

    def drop(self, ref: MomentRef, span: range) -> None:
        """Remove a part of a moment; its exact score for an empty span."""
        if span:
            self._drop(ref.moment, _name(span))
        else:
            self._record(_EXACT, ref.moment).unlink()

    def read(self, ref: MomentRef, span: range) -> pa.Table:
        """Read the futures of a part of a moment."""
        return self._read(ref.moment, _name(span), _file(_FUTURES, ref, span))


def _name(span: range) -> str:
    return _PAIRS if is_pairs(span) else f"futures-{span.start:05d}-{span.stop - 1:05d}"


def _file(kind: str, ref: MomentRef, span: range) -> str:
    return f"{kind}/location={ref.location}/seed={ref.moment}/{_name(span)}.parquet"
