"""Settings of a study, and workers that run its moments without files; roads are converted once each."""

from __future__ import annotations

import dataclasses
import pickle
import weakref
import zlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, ClassVar, TypeAlias, TypeVar

from scex_sumo.base.errors import OutOfTimeError, TrackError, UsageError, reason_of
from scex_sumo.base.files import TemporaryFolder, writing
from scex_sumo.base.version import __version__
from scex_sumo.behaviors.spec import ModelSpec
from scex_sumo.converters.net.sumo_net import SumoNet
from scex_sumo.converters.registries import Recording
from scex_sumo.extrapolation.models import ModelSet
from scex_sumo.extrapolation.processes.pool import WorkersDied
from scex_sumo.extrapolation.processes.workers import Workers
from scex_sumo.extrapolation.settings import Models, RunSettings
from scex_sumo.lanelet2sumo.convert import converted
from scex_sumo.metrics.registry import describe_metrics, thresholds_of
from scex_sumo.road import Road
from scex_sumo.roads.matching import off_road
from scex_sumo.scene import SeedScene
from scex_sumo.studies.moments.folder import Failure, MomentRef


@dataclass(frozen=True, kw_only=True)
class StudySettings:
    """Settings that all studies of moments share.

    Attributes:
        run: of each moment.
        every: least time between two moments of a recording, s; every case is a moment.
    """

    run: RunSettings = field(default_factory=lambda: RunSettings(futures=96))
    every: float = 1.0

    def __post_init__(self) -> None:
        if not self.every > 0:
            raise UsageError(f"--every: got {self.every:g}, needs seconds above 0")
        run = self.run
        if run.count is None or run.assign or run.under_test:
            raise UsageError(
                "a study draws the models of all vehicles in a fixed number of futures; "
                "leave out futures='all', assign and under_test"
            )
        models = written(run.models)
        object.__setattr__(self, "run", dataclasses.replace(run, models=models, world=built(models).world))

    @property
    def futures(self) -> int:
        """Maximum number of futures of a moment."""
        assert self.run.count is not None
        return self.run.count

    @property
    def models(self) -> tuple[str | ModelSpec, ...]:
        """Models as on the command line, and users' objects."""
        models = self.run.models
        assert isinstance(models, tuple)
        return models

    def identity(self, recordings: Sequence[Recording]) -> dict[str, Any]:
        """Return the values that identify a study; name and size stand for a recording."""
        run, described = self.run, describe_metrics(self.run.measured)
        limits = {**thresholds_of(run.measured), **run.thresholds}
        return {
            "recordings": [_described(recording) for recording in recordings],
            "every_s": self.every,
            "futures": self.futures,
            "models": [m if isinstance(m, str) else f"{m}@{m.weight!r} {m.state}" for m in self.models],
            "weights": built(self.models).weights,
            "steps": run.steps,
            "replan": run.replan,
            "design": run.design,
            **({"metrics": described} if described else {}),
            "seed": run.seed,
            "thresholds": {column: limits[column] for column in run.columns if column in limits},
            "version": __version__,
        }


def _described(recording: Recording) -> dict[str, Any]:
    files = (recording.map_path, *recording.track_paths)
    sizes = [file.stat().st_size if file.exists() else None for file in files]
    chosen = {"window_s": list(recording.window)} if recording.window != (None, None) else {}
    return {"name": recording.name, "site": recording.site, "bytes": sizes} | chosen


def written(models: Models) -> tuple[str | ModelSpec, ...]:
    """Return models to draw from as on the command line, and users' objects as they are."""
    drawn = ModelSet.of(RunSettings(models=models)).drawn
    texts = [f"{spec}@{spec.weight!r}" if spec.weight != 1 else str(spec) for spec in drawn]
    return tuple(text if spec.model is None else spec for text, spec in zip(texts, drawn, strict=True))


@lru_cache(maxsize=4)
def built(models: tuple[str | ModelSpec, ...]) -> ModelSet:
    """Build models, once in a process."""
    return ModelSet.of(RunSettings(models=models))


Task = TypeVar("Task", bound="MomentTask")
Result = TypeVar("Result")


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
    """One moment, to be run: its seed scene without the road, which is packed.

    One that ``may_be_late`` fails alone when it is out of its time; else the study ends.
    """

    may_be_late: ClassVar[bool] = False

    ref: MomentRef
    scene: SeedScene
    road: bytes
    settings: StudySettings


def attempt(work: Callable[[Task, SeedScene], Result], task: Task) -> Result | Failure:
    """Return the result of ``work`` on a task and its seed scene with the road, or the moment's failure."""
    try:
        road = unpack_road(task.road)
        scene = dataclasses.replace(task.scene, road=road)
        if len(off_road(road, scene)) == scene.vehicles:
            raise TrackError(
                f"none of its {scene.vehicles} vehicles is on a mapped lane; check the map's origin"
            )
        return work(task, scene)
    except OutOfTimeError:  # of a driver, which would let every moment wait as long
        raise
    except Exception as error:  # whatever it is, the other moments go on
        return Failure.of(task.ref, reason_of(error))


@lru_cache(maxsize=8)
def net_of(packed: bytes) -> SumoNet:
    """Return the net of a packed road; its folder is removed with it."""
    road, folder = unpack_road(packed), TemporaryFolder()
    with writing(Path(folder.name)):
        net = converted(road, Path(folder.name) / "map.net.xml")
    weakref.finalize(net, folder.cleanup)
    return net


Done: TypeAlias = tuple[MomentTask, Any]
Work: TypeAlias = Callable[[Any, SeedScene], Any]
"""A function of a module: returns the result of a `MomentTask` and its seed scene with the road."""


class MomentWorkers(Workers):
    """Worker processes, one moment at a time each; this process loads recordings and writes."""

    def __init__(self, count: int) -> None:
        if count < 1:
            raise UsageError(f"--workers: got {count}, needs at least 1")
        super().__init__(count + 1)

    def run_each(self, work: Work, tasks: Iterable[MomentTask]) -> Iterator[Done]:
        """Run tasks, a few at a time; yield them with their results, or `Failure`s, as they finish."""
        assert self.pool is not None
        opened = partial(_opened, work)
        for task, future in self.pool.run_each(opened, tasks, where=lambda t: f"at {t.ref.moment}"):
            try:
                yield task, future.result()
            except OutOfTimeError as error:
                if not task.may_be_late:
                    raise
                yield task, Failure.of(task.ref, reason_of(error))
            except WorkersDied as error:
                _, ends = error.args
                died = f"its worker died {len(ends)} times ({', '.join(ends)})"
                reason = f"{died}: out of memory, killed, or a crash"
                yield task, Failure.of(task.ref, reason, died=True)


def _opened(work: Work) -> AbstractContextManager[Callable[[MomentTask, object], Any]]:
    return nullcontext(lambda task, _: attempt(work, task))
