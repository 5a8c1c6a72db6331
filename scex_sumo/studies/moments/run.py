"""Run a moment in a worker, without files of the dataset; a worker converts each road to a net once."""

from __future__ import annotations

import dataclasses
import pickle
import threading
import weakref
import zlib
from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar

from scex_sumo.base.errors import TrackError, UsageError, reason_of
from scex_sumo.base.files import TemporaryFolder, writing
from scex_sumo.base.version import __version__
from scex_sumo.converters.net.convert import converted
from scex_sumo.converters.net.sumo_net import SumoNet
from scex_sumo.road import Road
from scex_sumo.roads.matching import off_road
from scex_sumo.scene import SeedScene
from scex_sumo.studies.moments.references import Failure, MomentRef
from scex_sumo.studies.moments.settings import StudySettings, built

Task = TypeVar("Task", bound="MomentTask")
Result = TypeVar("Result")

COMPARED_EVERY = 16


def pack_road(road: Road) -> bytes:
    """Pickle and compress a road for workers."""
    return zlib.compress(pickle.dumps(road, protocol=pickle.HIGHEST_PROTOCOL))


@lru_cache(maxsize=8)
def unpack_road(packed: bytes) -> Road:
    """Return the road of `pack_road`, one object for all moments of a map."""
    road = pickle.loads(zlib.decompress(packed))
    assert isinstance(road, Road)
    return road


@dataclass(frozen=True, kw_only=True, eq=False)
class MomentTask:
    """Some children of one moment, to be run.

    Attributes:
        scene: its seed scene, without the road.
        road: packed; None if the workers get it separately.
        version: of the package that made the task.
    """

    ref: MomentRef
    scene: SeedScene
    road: bytes | None
    children: range
    settings: StudySettings
    version: str = __version__

    @classmethod
    def of(cls: type[Task], task: MomentTask, **more: Any) -> Task:
        """Return a task of a subclass with ``more`` fields."""
        return cls(**{field.name: getattr(task, field.name) for field in fields(MomentTask)}, **more)


# libsumo runs one simulation per process: tasks that share one, as in a Dask worker of several threads, wait.
one_at_a_time = threading.Lock()
_compared_on = weakref.WeakSet[SumoNet]()


def attempt(
    work: Callable[[Task, SeedScene, SumoNet], Result], task: Task, road: bytes | None
) -> Result | Failure:
    """Return the result of ``work`` on a seed scene with road and net, or the moment's failure."""
    packed = task.road or road
    try:
        assert packed is not None, "no road"
        check_versions(task)
        with one_at_a_time:
            whole, net = road_and_net(packed, task.settings.cache)
            scene = dataclasses.replace(task.scene, road=whole)
            if len(off_road(whole, scene)) == scene.vehicles:
                raise TrackError(
                    f"none of its {scene.vehicles} vehicles is on a mapped lane; check the map's origin"
                )
            return work(task, scene, net)
    except Exception as error:  # whatever it is, the other moments go on
        return Failure.of(task.ref, reason_of(error))


def check_versions(task: MomentTask) -> None:
    """Refuse tasks of another version of the package or the weights, which give other values."""
    if task.version != __version__:
        raise UsageError(
            f"the worker has scex-sumo {__version__}, needs {task.version}; install the same everywhere"
        )
    if built(task.settings.models).weights != task.settings.weights:
        raise UsageError("the worker has other weights of learned models; install the same everywhere")


@lru_cache(maxsize=8)
def road_and_net(packed: bytes, cache: bool) -> tuple[Road, SumoNet]:
    """Return a road and its net, whose folder is removed with it."""
    road, folder = unpack_road(packed), TemporaryFolder()
    with writing(Path(folder.name)):
        net = converted(road, Path(folder.name) / "map.net.xml", keep=cache)
    weakref.finalize(net, folder.cleanup)
    return road, net


def compared(net: SumoNet, ref: MomentRef) -> bool:
    """Whether SUMO checks children of a moment: of a worker's first on a map, and of every 16th."""
    first = net not in _compared_on
    _compared_on.add(net)
    return first or zlib.crc32(ref.moment.encode()) % COMPARED_EVERY == 0
