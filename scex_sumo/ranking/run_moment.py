"""Moment in a worker: its children, run and measured in memory.

A worker needs no file of the dataset: seed scene and road come with the task. It keeps the roads that it has
met, each converted to a SUMO net once.
"""

from __future__ import annotations

import dataclasses
import pickle
import tempfile
import threading
import weakref
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from shutil import rmtree

import numpy as np
import pyarrow as pa

from scex_sumo.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.converters.net.convert import SumoNet, convert
from scex_sumo.errors import TrackError, UsageError, reason_of
from scex_sumo.extrapolation.job import Job, batch_size, batches_of, run_batch
from scex_sumo.metrics.registry import COLUMNS, side_of
from scex_sumo.ranking.moments import Failure, MomentRef
from scex_sumo.ranking.settings import RankSettings, built
from scex_sumo.results.folder import tracks_table
from scex_sumo.results.parts import Part
from scex_sumo.road import Road
from scex_sumo.roads.routes import off_road
from scex_sumo.scene import SeedScene
from scex_sumo.version import __version__
from scex_sumo.world.sumo import SumoWorld

KEEP_MOST = 5
"""Children of a moment whose tracks ``critical`` keeps at most."""


def pack_road(road: Road) -> bytes:
    """Road as it goes to workers, pickled and compressed."""
    return zlib.compress(pickle.dumps(road, protocol=pickle.HIGHEST_PROTOCOL))


def unpack_road(packed: bytes) -> Road:
    """The reverse of `pack_road`."""
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
        values: (C, 12) NaN where undefined.
        defined: (C, 12).
        critical: (C, M) by each metric that has a threshold.
        fallbacks: (C,) how many plans are the path-following driver's, where a model had none.
        kept: (C,) whose states are in ``tracks``.
        models: (C, V) who drives.
        track_ids: (V,) whom.
        tracks: INTERACTION columns, or None where nothing is kept.
    """

    children: IntArray
    values: FloatArray
    defined: BoolArray
    critical: BoolArray
    fallbacks: IntArray
    kept: BoolArray
    models: tuple[tuple[str, ...], ...]
    track_ids: IntArray
    tracks: pa.Table | None


# libsumo runs one simulation per process: tasks that share one, as in a Dask worker of several threads, wait.
one_at_a_time = threading.Lock()


def run_moment(task: MomentTask, road: bytes | None = None) -> MomentPart | Failure:
    """Children of a task, run on its road or the one given; or what is wrong with the moment."""
    packed = task.road or road
    try:
        assert packed is not None, "no road"
        check_versions(task)
        with one_at_a_time:
            return _run(task, *converted(packed))
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
def converted(packed: bytes) -> tuple[Road, SumoNet]:
    """The road and its net, whose folder goes with it; made at the first moment of a map."""
    road, folder = unpack_road(packed), tempfile.mkdtemp(prefix="scex-rank-")
    net = convert(road, Path(folder) / "map.net.xml")
    weakref.finalize(net, rmtree, folder, ignore_errors=True)
    return road, net


def _run(task: MomentTask, road: Road, net: SumoNet) -> MomentPart:
    scene = dataclasses.replace(task.scene, road=road)
    off = off_road(road, scene)
    if len(off) == scene.vehicles:
        raise TrackError(f"none of its {scene.vehicles} vehicles is on a mapped lane; check the map's origin")
    job = _job(task, scene, net)
    batches = batches_of(task.children, batch_size(job), apart=job.apart)
    slots = sorted({int(slot) for batch in batches for slot in job.slots(batch)})
    with SumoWorld(net, scene, slots=slots) as world:
        parts = [run_batch(job, world, batch) for batch in batches]
    return _collected(task, job, parts)


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
    )


def _collected(task: MomentTask, job: Job, parts: list[Part]) -> MomentPart:
    children = np.concatenate([part.children for part in parts])
    values = np.concatenate([part.values for part in parts])
    defined = np.concatenate([part.defined for part in parts])
    critical = critical_by(values, defined, task.settings.thresholds)
    kept = choose_kept(critical, task.settings.keep, task.spare)
    names = np.asarray(job.models.names, dtype=object)[job.assignment[children]]
    return MomentPart(
        children=children,
        values=values,
        defined=defined,
        critical=critical,
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


def critical_by(values: FloatArray, defined: BoolArray, thresholds: Mapping[str, float]) -> BoolArray:
    """(C, M) which children are critical by each metric that has a threshold; undefined ones are not.

    Args:
        values: (C, 12).
        defined: (C, 12).
        thresholds: by metric column.
    """
    result = np.zeros((len(values), len(thresholds)), dtype=bool)
    for m, (column, limit) in enumerate(thresholds.items()):
        index = COLUMNS.index(column)
        sample = values[:, index]
        beyond = sample <= limit if side_of(column) == "left" else sample >= limit
        result[:, m] = beyond & defined[:, index]
    return result


def choose_kept(critical: BoolArray, keep: str, spare: int) -> BoolArray:
    """(C,) whose tracks are kept: of ``critical`` those critical by most metrics, the first of equals."""
    count = critical.sum(axis=1)
    if keep != "critical":
        return np.full(len(critical), keep == "all")
    kept = np.zeros(len(critical), dtype=bool)
    kept[np.argsort(-count, kind="stable")[:spare]] = True
    return np.asarray(kept & (count > 0), dtype=bool)


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
