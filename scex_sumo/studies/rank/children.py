"""Children of a moment of a ranking: run and measured in a worker, scored, and as a table."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pyarrow as pa

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.converters.net.sumo_net import SumoNet
from scex_sumo.evaluation.encounters import answers_of
from scex_sumo.evaluation.outcomes import encounters_of_rows
from scex_sumo.extrapolation.job import Job, parts_in_memory
from scex_sumo.results.folder import tracks_table
from scex_sumo.results.parts import Part
from scex_sumo.scene import SeedScene
from scex_sumo.studies.moments.folder import Failure
from scex_sumo.studies.moments.run import MomentTask, attempt, compared
from scex_sumo.studies.moments.settings import built
from scex_sumo.studies.rank.settings import MIXED, RankSettings

MAX_KEPT = 5
"""Children of a moment whose tracks ``critical`` keeps at most."""
CRITICAL_WEIGHT = 0.1
"""Of a critical encounter beside a collision in the score of a moment."""
MICRO = 10**6
PAIR_NUMBERS = 5  # of a critical encounter
HARD_MPS = 10.0
"""Relative speed at impact that makes a collision count twice."""


@dataclass(frozen=True, kw_only=True, eq=False)
class RankTask(MomentTask):
    """A moment to be ranked.

    Attributes:
        spare: how many more children may have their tracks kept.
    """

    settings: RankSettings
    spare: int


@dataclass(frozen=True, kw_only=True, eq=False)
class MomentPart:
    """Measured children of one moment.

    Attributes:
        children: one row each, see `children_schema`.
        tracks: INTERACTION columns of the kept children; None if none is kept.
    """

    children: pa.Table
    tracks: pa.Table | None


def run_moment(task: RankTask, road: bytes | None = None) -> MomentPart | Failure:
    """Run the children of a task on its road or the one given; or return the moment's failure."""
    return attempt(_run, task, road)


def _run(task: RankTask, scene: SeedScene, net: SumoNet) -> MomentPart:
    models, run = built(task.settings.models), task.settings.run
    if task.children.start == 0:
        models.try_on(scene, seed=run.seed)
    drawn = models.draw(scene.track_ids, children=task.children.stop, seed=run.seed, design=run.design)
    same = compared(net, task.ref)
    job = Job(scene, net, run, models, drawn, net.path.parent, compared=same)
    parts = parts_in_memory(job, task.children)
    pairs = [rows for part in parts for rows in _critical_pairs(part, scene.track_ids)]
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


def _critical_pairs(part: Part, track_ids: IntArray) -> list[IntArray]:
    assert part.encounters is not None and part.collisions is not None
    injured = {
        (hit["child"], frozenset((hit["track_id"], hit["other_id"]))): round(
            MICRO * ((hit["p_mais3"] or 0.0) + (hit["p_mais3_other"] or 0.0))
        )
        for hit in part.collisions.to_pylist()
    }
    found = encounters_of_rows(part.encounters)
    answers = answers_of(found)
    some = np.flatnonzero(answers["critical"])
    speed = np.round(100 * found.relative_speed[some])
    hits = answers["collision"][some]
    child, one, other = found.child[some], track_ids[found.first[some]], track_ids[found.second[some]]
    pairs = zip(child.tolist(), one.tolist(), other.tolist(), strict=True)
    injuries = np.array([injured.get((c, frozenset((a, b))), 0) for c, a, b in pairs], dtype=np.int64)
    rows = np.stack([one, other, hits, speed, injuries], axis=-1)
    return [rows[child == number].astype(np.int64) for number in part.children]


def score_of(pairs: Sequence[IntArray], by: str = MIXED) -> FloatArray:
    """Return the scores (C,) of children from their critical encounters.

    ``mixed``: a collision counts 1 and its relative speed over 10 m/s; each critical encounter counts 0.1.
    ``severity``: expected severe injuries. ``collisions``, ``encounters``: their number.
    """
    if by != MIXED:
        counts = {"severity": lambda r: r[:, 4].sum() / MICRO, "collisions": lambda r: r[:, 2].sum()}
        return np.array([float(counts.get(by, len)(rows)) for rows in pairs], dtype=np.float64)
    hard = [(rows[:, 2] * (1 + rows[:, 3] / (100 * HARD_MPS))).sum() for rows in pairs]
    return np.array(hard, dtype=np.float64) + CRITICAL_WEIGHT * np.array([len(rows) for rows in pairs])


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


def pairs_of(table: pa.Table) -> list[IntArray]:
    """Return the critical encounters (E, 5) of each child.

    Rows are track_id, other_id, 1 in a collision, the relative speed at impact in cm/s, and the expected
    severe injuries in millionths.
    """
    return [
        np.asarray(row, dtype=np.int64).reshape(-1, PAIR_NUMBERS)
        for row in table["critical_pairs"].to_pylist()
    ]
