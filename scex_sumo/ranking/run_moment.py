"""Moment in a worker: its children, run and measured in memory.

A worker needs no file of the dataset: seed scene and road come with the task. It keeps the roads that it has
met, each converted to a SUMO net once.
"""

from __future__ import annotations

import dataclasses
import pickle
import threading
import weakref
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TypeVar

import numpy as np
import pyarrow as pa

from scex_sumo.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.converters.net.kept import converted
from scex_sumo.converters.net.sumo_net import SumoNet
from scex_sumo.errors import TrackError, UsageError, reason_of
from scex_sumo.evaluation.encounters import answers_of
from scex_sumo.evaluation.outcomes import encounters_of_rows
from scex_sumo.extrapolation.job import Job, parts_in_memory
from scex_sumo.files import TemporaryFolder, writing
from scex_sumo.ranking.moments import Failure, MomentRef
from scex_sumo.ranking.settings import RankSettings, built
from scex_sumo.results.folder import tracks_table
from scex_sumo.results.parts import Part
from scex_sumo.road import Road
from scex_sumo.roads.routes import off_road
from scex_sumo.scene import SeedScene
from scex_sumo.version import __version__

Found = TypeVar("Found")

COMPARED_EVERY = 16
KEEP_MOST = 5
"""Children of a moment whose tracks ``critical`` keeps at most."""
CRITICAL_WEIGHT = 0.1
"""Of a critical encounter beside a collision in the score of a moment."""
HARD_MPS = 10.0
"""Relative speed at impact that makes a collision count twice."""


def pack_road(road: Road) -> bytes:
    """Road as it goes to workers, pickled and compressed."""
    return zlib.compress(pickle.dumps(road, protocol=pickle.HIGHEST_PROTOCOL))


@lru_cache(maxsize=8)
def unpack_road(packed: bytes) -> Road:
    """The reverse of `pack_road`; one road for all moments of a map, which share what follows from it."""
    road = pickle.loads(zlib.decompress(packed))
    assert isinstance(road, Road)
    return road


@dataclass(frozen=True, kw_only=True, eq=False)
class MomentTask:
    """Some children of one moment, to be run.

    Attributes:
        ref: the moment.
        scene: its seed scene, without the road.
        road: the road, packed; None where it goes to the workers by another way.
        children: their numbers.
        spare: how many more children may have their tracks kept.
        settings: those of the ranking.
        version: of this package where the task was made.
    """

    ref: MomentRef
    scene: SeedScene
    road: bytes | None
    children: range
    spare: int
    settings: RankSettings
    version: str = __version__


@dataclass(frozen=True, kw_only=True, eq=False)
class MomentPart:
    """Children of one moment, measured.

    Attributes:
        children: (C,) their numbers.
        columns: the M metric columns.
        values: (C, M) NaN where undefined.
        defined: (C, M).
        pairs: (C,) for each child its critical encounters as rows track_id, other_id, 1 where they collide,
            their relative speed at impact in cm/s.
        fallbacks: (C,) how many plans are the path-following driver's, where a model had none.
        kept: (C,) whose states are in ``tracks``.
        models: (C, V) who drives.
        track_ids: (V,) whom.
        tracks: INTERACTION columns, or None where nothing is kept.
    """

    children: IntArray
    columns: tuple[str, ...]
    values: FloatArray
    defined: BoolArray
    pairs: tuple[IntArray, ...]
    fallbacks: IntArray
    kept: BoolArray
    models: tuple[tuple[str, ...], ...]
    track_ids: IntArray
    tracks: pa.Table | None


# libsumo runs one simulation per process: tasks that share one, as in a Dask worker of several threads, wait.
one_at_a_time = threading.Lock()
_compared_on = weakref.WeakSet[SumoNet]()


def run_moment(task: MomentTask, road: bytes | None = None) -> MomentPart | Failure:
    """Children of a task, run on its road or the one given; or what is wrong with the moment."""
    return worked(_run, task, road)


def worked(
    work: Callable[[MomentTask, Road, SumoNet], Found], task: MomentTask, road: bytes | None
) -> Found | Failure:
    """What some work finds of a moment, alone in its process; or what is wrong with the moment."""
    packed = task.road or road
    try:
        assert packed is not None, "no road"
        check_versions(task)
        with one_at_a_time:
            return work(task, *road_and_net(packed, task.settings.cache))
    except Exception as error:  # whatever it is, the other moments go on
        return Failure.of(task.ref, reason_of(error))


def check_versions(task: MomentTask) -> None:
    """A worker of another version would give other values."""
    if task.version != __version__:
        raise UsageError(
            f"the worker has scex-sumo {__version__}, needs {task.version}; install the same everywhere"
        )
    if built(task.settings.models).weights != task.settings.weights:
        raise UsageError("the worker has other weights of learned models; install the same everywhere")


@lru_cache(maxsize=8)
def road_and_net(packed: bytes, cache: bool) -> tuple[Road, SumoNet]:
    """The road and its net, whose folder goes with it; made at the first moment of a map."""
    road, folder = unpack_road(packed), TemporaryFolder()
    with writing(Path(folder.name)):
        net = converted(road, Path(folder.name) / "map.net.xml", keep=cache)
    weakref.finalize(net, folder.cleanup)
    return road, net


def _run(task: MomentTask, road: Road, net: SumoNet) -> MomentPart:
    scene = dataclasses.replace(task.scene, road=road)
    off = off_road(road, scene)
    if len(off) == scene.vehicles:
        raise TrackError(f"none of its {scene.vehicles} vehicles is on a mapped lane; check the map's origin")
    job = _job(task, scene, net)
    return _collected(task, job, parts_in_memory(job, task.children))


def compared(net: SumoNet, ref: MomentRef) -> bool:
    """Whether SUMO holds some of a moment's children, too: of a worker's first on a map, and every 16th."""
    first = net not in _compared_on
    _compared_on.add(net)
    return first or zlib.crc32(ref.moment.encode()) % COMPARED_EVERY == 0


def _job(task: MomentTask, scene: SeedScene, net: SumoNet) -> Job:
    """The run that the children are of; at the first of them, every model has shown that it can plan."""
    settings = task.settings
    models, run = built(settings.models), settings.run
    if task.children.start == 0:
        models.try_on(scene, seed=run.seed)
    return Job(
        scene=scene,
        net=net,
        settings=run,
        models=models,
        assignment=models.draw(
            scene.track_ids, children=task.children.stop, seed=run.seed, design=run.design
        ),
        folder=net.path.parent,
        compared=compared(net, task.ref),
    )


def _collected(task: MomentTask, job: Job, parts: list[Part]) -> MomentPart:
    children = np.concatenate([part.children for part in parts])
    values = np.concatenate([part.values for part in parts])
    defined = np.concatenate([part.defined for part in parts])
    pairs = tuple(rows for part in parts for rows in _critical_pairs(part, job.scene.track_ids))
    kept = choose_kept(score_of(pairs), task.settings.keep, task.spare)
    names = np.asarray(job.models.names, dtype=object)[job.assignment[children]]
    return MomentPart(
        children=children,
        columns=job.settings.columns,
        values=values,
        defined=defined,
        pairs=pairs,
        fallbacks=np.concatenate([_fallbacks(part) for part in parts]),
        kept=kept,
        models=tuple(tuple(row) for row in names.tolist()),
        track_ids=np.asarray(job.scene.track_ids, dtype=np.int64),
        tracks=_tracks(job.scene, parts, kept) if kept.any() else None,
    )


def _fallbacks(part: Part) -> IntArray:
    """(C,) plans of each child that are not its models' own."""
    if part.fallbacks is None:
        return np.zeros(len(part.children), dtype=np.int64)
    of_child = np.asarray(part.fallbacks["child"], dtype=np.int64)
    row = np.searchsorted(part.children, of_child)
    return np.bincount(row, minlength=len(part.children)).astype(np.int64)


def _critical_pairs(part: Part, track_ids: IntArray) -> list[IntArray]:
    """For each child its critical encounters, see `MomentPart`."""
    assert part.encounters is not None
    found = encounters_of_rows(part.encounters)
    answers = answers_of(found)
    some = np.flatnonzero(answers["critical"])
    speed = np.round(100 * found.relative_speed[some])
    hits = answers["collision"][some]
    rows = np.stack([track_ids[found.first[some]], track_ids[found.second[some]], hits, speed], axis=-1)
    child = found.child[some]
    return [rows[child == number].astype(np.int64) for number in part.children]


def score_of(pairs: Sequence[IntArray]) -> FloatArray:
    """(C,) score of children from their critical encounters.

    A collision counts 1 and its relative speed over 10 m/s; every critical encounter, collision or not, 0.1.
    """
    hard = [(rows[:, 2] * (1 + rows[:, 3] / (100 * HARD_MPS))).sum() for rows in pairs]
    return np.array(hard, dtype=np.float64) + CRITICAL_WEIGHT * np.array([len(rows) for rows in pairs])


def choose_kept(score: FloatArray, keep: str, spare: int) -> BoolArray:
    """(C,) whose tracks are kept: of ``critical`` those of the greatest score, the first of equals."""
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
