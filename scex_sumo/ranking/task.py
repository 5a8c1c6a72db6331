"""What a worker does: the children of one seed scene, run and measured in memory.

A worker needs no file of the dataset: the seed scene comes with the task, the road with its parcel. It keeps
the roads that it has met, each converted to a SUMO net once.
"""

from __future__ import annotations

import dataclasses
import hashlib
import pickle
import tempfile
import threading
import zlib
from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from scex_sumo.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.converters.net.convert import SumoNet, convert
from scex_sumo.errors import TrackError, UsageError
from scex_sumo.extrapolation.job import Job, batch_size, batches_of, run_batch
from scex_sumo.extrapolation.models import ModelSet
from scex_sumo.extrapolation.settings import RunSettings
from scex_sumo.metrics.evaluate import COLUMNS
from scex_sumo.ranking.seeds import reason_of
from scex_sumo.results.folder import tracks_table
from scex_sumo.results.parts import Part
from scex_sumo.road import Road
from scex_sumo.roads.routes import off_road
from scex_sumo.scene import SeedScene
from scex_sumo.statistics.density import side_of
from scex_sumo.version import __version__
from scex_sumo.world.sumo import SumoWorld

KEEP = ("none", "critical", "all")
KEEP_MOST = 5
"""Children of a seed whose tracks ``critical`` keeps at most."""

_MAPS_KEPT = 8


@dataclass(frozen=True, kw_only=True)
class Settings:
    """What all seeds of a ranking have in common.

    Attributes:
        models: behaviour models to draw from, as on the command line.
        weights: learned model and the digest of its weights.
        steps: steps of 0.1 s per child.
        replan: steps that a plan is followed.
        design: how assignments are drawn; fewer children must be the first of more.
        seed: of the random numbers, the same for all seed scenes.
        thresholds: metric column and its threshold, in the order of the columns.
        keep: whose tracks are kept, one of `KEEP`.
    """

    models: tuple[str, ...]
    weights: tuple[tuple[str, str], ...]
    steps: int
    replan: int
    design: str
    seed: int
    thresholds: tuple[tuple[str, float], ...]
    keep: str


@dataclass(frozen=True, kw_only=True, eq=False)
class SeedTask:
    """Some children of one seed scene, to be run.

    Attributes:
        seed: name of the seed.
        scene: the seed scene without its road.
        first: number of the first child.
        stop: one more than that of the last.
        spare: how many more children may have their tracks kept.
        settings: those of the ranking.
        version: of this package where the task was made.
    """

    seed: str
    scene: SeedScene
    first: int
    stop: int
    spare: int
    settings: Settings
    version: str = __version__


@dataclass(frozen=True, kw_only=True)
class Parcel:
    """A road on its way to workers.

    Attributes:
        key: its digest.
        packed: the road, pickled and compressed.
    """

    key: str
    packed: bytes

    @classmethod
    def of(cls, road: Road) -> Parcel:
        """Pack a road."""
        plain = pickle.dumps(road, protocol=pickle.HIGHEST_PROTOCOL)
        return cls(key=hashlib.sha256(plain).hexdigest()[:32], packed=zlib.compress(plain))

    def road(self) -> Road:
        """The road."""
        road = pickle.loads(zlib.decompress(self.packed))
        assert isinstance(road, Road)
        return road


@dataclass(frozen=True, kw_only=True, eq=False)
class SeedPart:
    """Children of one seed, measured.

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
_one_at_a_time = threading.Lock()
_maps: OrderedDict[str, tuple[Road, SumoNet, Any]] = OrderedDict()


def run_seed(task: SeedTask, parcel: Parcel) -> SeedPart | str:
    """Run the children of a task; in words what is wrong with the seed scene where that fails."""
    try:
        _check_versions(task)
        with _one_at_a_time:
            return _run(task, *_mapped(parcel))
    except Exception as error:  # whatever it is, the other seeds go on
        return reason_of(error)


def _check_versions(task: SeedTask) -> None:
    """A worker of another version would give other values."""
    if task.version != __version__:
        raise UsageError(
            f"the worker has scex-sumo {__version__}, needs {task.version}; install the same everywhere"
        )
    if _models(task.settings.models).weights != dict(task.settings.weights):
        raise UsageError("the worker has other weights of learned models; install the same everywhere")


def _mapped(parcel: Parcel) -> tuple[Road, SumoNet]:
    """The road and its net; converted at the first seed of a map."""
    if parcel.key not in _maps:
        road = parcel.road()
        folder = tempfile.TemporaryDirectory(prefix="scex-rank-", ignore_cleanup_errors=True)
        _maps[parcel.key] = road, convert(road, Path(folder.name) / "map.net.xml"), folder
        while len(_maps) > _MAPS_KEPT:
            _maps.popitem(last=False)[1][2].cleanup()
    _maps.move_to_end(parcel.key)
    road, net, _ = _maps[parcel.key]
    return road, net


@lru_cache(maxsize=4)
def _models(models: tuple[str, ...]) -> ModelSet:
    return ModelSet.of(RunSettings(models=models))


def _run(task: SeedTask, road: Road, net: SumoNet) -> SeedPart:
    scene = dataclasses.replace(task.scene, road=road)
    off = off_road(road, scene)
    if len(off) == scene.vehicles:
        raise TrackError(f"none of its {scene.vehicles} vehicles is on a mapped lane; check the map's origin")
    settings = task.settings
    models = _models(settings.models)
    if task.first == 0:
        models.try_on(scene, seed=settings.seed)
    run = RunSettings(
        models=models.drawn,
        children=task.stop,
        design=settings.design,
        steps=settings.steps,
        replan=settings.replan,
        seed=settings.seed,
        keep_plans=False,
    )
    assignment = models.draw(scene.track_ids, children=task.stop, seed=run.seed, design=run.design)
    job = Job(
        scene=scene,
        net=net,
        settings=run,
        models=models,
        assignment=assignment,
        folder=net.path.parent,
    )
    batches = batches_of(range(task.first, task.stop), batch_size(job), apart=job.apart)
    slots = sorted({int(slot) for batch in batches for slot in job.slots(batch)})
    with SumoWorld(net, scene, slots=slots) as world:
        parts = [run_batch(job, world, batch) for batch in batches]
    return _collected(task, job, parts)


def _collected(task: SeedTask, job: Job, parts: list[Part]) -> SeedPart:
    children = np.concatenate([part.children for part in parts])
    values = np.concatenate([part.values for part in parts])
    defined = np.concatenate([part.defined for part in parts])
    critical = critical_by(values, defined, dict(task.settings.thresholds))
    kept = choose_kept(critical, task.settings.keep, task.spare)
    names = np.asarray(job.models.names, dtype=object)[job.assignment[children]]
    return SeedPart(
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
