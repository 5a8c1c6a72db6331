"""Children of a moment of a ranking: run and measured in a worker, and as a table."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pyarrow as pa

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.converters.net.sumo_net import SumoNet
from scex_sumo.extrapolation.job import Job, parts_in_memory
from scex_sumo.results.folder import tracks_table
from scex_sumo.results.parts import Part
from scex_sumo.scene import SeedScene
from scex_sumo.studies.moments.folder import Failure
from scex_sumo.studies.moments.run import MomentTask, attempt, compared
from scex_sumo.studies.moments.settings import built
from scex_sumo.studies.rank.exact import ExactScore, find_exact_score
from scex_sumo.studies.rank.scores import RankSettings, critical_pairs, score_of

MAX_KEPT = 5
"""Children of a moment whose tracks ``critical`` keeps at most."""


@dataclass(frozen=True, kw_only=True, eq=False)
class RankTask(MomentTask):
    """A moment to be ranked.

    Attributes:
        spare: how many more children may have their tracks kept.
        drawn: critical encounters of all drawn children, for the search of an exact score.
    """

    settings: RankSettings
    spare: int
    drawn: Sequence[IntArray] | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class MomentPart:
    """Measured children of one moment.

    Attributes:
        children: one row each, see `children_schema`.
        tracks: INTERACTION columns of the kept children; None if none is kept.
    """

    children: pa.Table
    tracks: pa.Table | None


def run_moment(task: RankTask, road: bytes | None = None) -> MomentPart | ExactScore | Failure:
    """Run the children of a task on its road or the one given; or return the moment's failure."""
    return attempt(_run, task, road)


def _run(task: RankTask, scene: SeedScene, net: SumoNet) -> MomentPart | ExactScore:
    models, run = built(task.settings.models), task.settings.run
    if task.children.start == 0:
        models.try_on(scene, seed=run.seed)
    count = task.children.stop if task.drawn is None else task.settings.children
    drawn = models.draw(scene.track_ids, children=count, seed=run.seed, design=run.design)
    same = compared(net, task.ref)
    job = Job(scene, net, run, models, drawn, net.path.parent, compared=same)
    if task.drawn is not None:
        return find_exact_score(job, task.drawn, task.settings.by)
    parts = parts_in_memory(job, task.children)
    pairs = [rows for part in parts for rows in critical_pairs(part, scene.track_ids)]
    kept = choose_kept(score_of(pairs, task.settings.by), task.settings.keep, task.spare)
    children = np.concatenate([part.children for part in parts])
    table = children_table(
        children,
        columns=run.columns,
        values=np.concatenate([part.values for part in parts]),
        defined=np.concatenate([part.defined for part in parts]),
        fallbacks=np.concatenate([_fallbacks(part) for part in parts]),
        kept=kept,
        track_ids=np.asarray(scene.track_ids, dtype=np.int64),
        models=np.asarray(models.names, dtype=object)[drawn[children]].tolist(),
        pairs=pairs,
    )
    return MomentPart(children=table, tracks=_tracks(scene, parts, kept) if kept.any() else None)


def _fallbacks(part: Part) -> IntArray:
    if part.fallbacks is None:
        return np.zeros(len(part.children), dtype=np.int64)
    of_child = np.asarray(part.fallbacks["child"], dtype=np.int64)
    row = np.searchsorted(part.children, of_child)
    return np.bincount(row, minlength=len(part.children)).astype(np.int64)


def choose_kept(score: FloatArray, keep: str, spare: int) -> BoolArray:
    """Return whose tracks (C,) are kept: of ``critical`` those of the greatest score above 0."""
    if keep != "critical":
        return np.full(len(score), keep == "all")
    kept = np.zeros(len(score), dtype=bool)
    kept[np.argsort(-score, kind="stable")[:spare]] = True
    return np.asarray(kept & (score > 0), dtype=bool)


def _tracks(scene: SeedScene, parts: list[Part], kept: BoolArray) -> pa.Table:
    tables = []
    start = 0
    for part in parts:
        some = kept[start : start + len(part.children)]
        start += len(part.children)
        if some.any():
            chosen = dataclasses.replace(part, children=part.children[some], states=part.states[some])
            tables.append(tracks_table(scene, chosen))
    return pa.concat_tables(tables)


def children_schema(columns: Sequence[str]) -> pa.Schema:
    """Return the columns of a moment's children; undefined metrics are null.

    ``fallbacks`` counts fallback plans. ``track_id`` and ``model`` have one entry for each vehicle,
    ``critical_pairs`` five for each critical encounter, see `pairs_of`.
    """
    return pa.schema(
        [
            ("child", pa.int32()),
            *((name, pa.float64()) for name in columns),
            ("fallbacks", pa.int32()),
            ("kept", pa.bool_()),
            ("track_id", pa.list_(pa.int64())),
            ("model", pa.list_(pa.string())),
            ("critical_pairs", pa.list_(pa.int64())),
        ]
    )


def children_table(
    children: IntArray,
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
    """Return rows of (C,) children, see `children_schema`.

    Args:
        values: (C, M) of the metric columns; ``defined`` too.
        models: (C, V), with ``track_ids`` (V,).
        pairs: (C,) of (E, 5), see `pairs_of`.
    """
    data = {"child": pa.array(children, pa.int32())}
    for index, name in enumerate(columns):
        data[name] = pa.array(values[:, index], mask=~defined[:, index])
    data["fallbacks"] = pa.array(fallbacks, pa.int32())
    data["kept"] = pa.array(kept)
    data["track_id"] = pa.array([track_ids.tolist()] * len(children), pa.list_(pa.int64()))
    data["model"] = pa.array([list(row) for row in models], pa.list_(pa.string()))
    data["critical_pairs"] = pa.array([rows.reshape(-1) for rows in pairs], pa.list_(pa.int64()))
    return pa.table(data)
