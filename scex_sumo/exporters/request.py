"""Export request: futures of a run, where to write them, the run's map and scene; registry of exporters.

Packages add entry points in ``scex_sumo.exporters``; ``--to`` also takes ``package.module:function``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Final, TypeAlias

import numpy as np

from scex_sumo.base.arrays import BoolArray
from scex_sumo.base.errors import UsageError
from scex_sumo.base.importing import Registry
from scex_sumo.base.outputs import output
from scex_sumo.converters.tracks.road_users import road_user
from scex_sumo.results.run import Run
from scex_sumo.road import Road
from scex_sumo.scene import LOGGED_HISTORY, Obstacles, SeedScene, States

_HEIGHTS_M = {"truck": 3.0, "bus": 3.2, "pedestrian": 1.75}
_HEIGHT_M = 1.6

Exporter: TypeAlias = Callable[["Request"], list[Path]]

RECORDED: Final = -1
"""The number that stands for the recorded future."""

EXPORTERS: Final = Registry(group="scex_sumo.exporters", kind="export format")


@dataclass(frozen=True, kw_only=True, eq=False)
class Participant:
    """Road user of a future.

    Attributes:
        label: track id of a vehicle; name of a replayed pedestrian or cyclist.
        name: SUMO's name of a vehicle of a simulation, else the label.
        vehicle: index in the seed scene; None for pedestrians and cyclists.
        index: among the vehicles, or among the others.
        states: (T,) from the first logged frame on; those of pedestrians and cyclists may end earlier.
        present: (T,) whether it is there.
    """

    label: int | str
    name: str
    vehicle: int | None
    index: int
    kind: str
    length: float
    width: float
    states: States
    present: BoolArray

    @property
    def height(self) -> float:
        """Assumed height, m: recordings from above have none."""
        return _HEIGHTS_M.get(road_user(self.kind), _HEIGHT_M)


@dataclass(frozen=True, kw_only=True)
class Request:
    """Export request: futures of a run, and where to write them.

    Attributes:
        out: file or folder; None: the exporter names it.
        ego: track id of the vehicle with the planning task.
        encounter: track ids by whose encounter they were chosen.

    Example:
        >>> request = scex.Request(run=run, futures=(0, 1))
        >>> request.states(0).x.shape[0] == len(request.models_of(0))
        True
    """

    run: Run
    futures: tuple[int, ...]
    out: Path | None = None
    ego: int | None = None
    encounter: tuple[int, int] | None = None

    @property
    def name(self) -> str:
        """Name of the seed scene."""
        return str(self.run.info["seed_scene"]["name"])

    @cached_property
    def scene(self) -> SeedScene:
        """The seed scene."""
        return self.run.scene

    @property
    def road(self) -> Road:
        """The road of the run."""
        return self.run.road

    @cached_property
    def folder(self) -> Path:
        """Folder to write, made if missing."""
        path = self.out if self.out is not None else Path(f"{self.name}_export")
        if path.exists() and not path.is_dir():
            raise UsageError(f"-o {path}: is a file; this format needs a folder")
        path.mkdir(parents=True, exist_ok=True)
        return path

    def file_stem(self, future: int) -> str:
        """Return the name of a future's file without its ending."""
        return f"{self.name}_recorded" if future == RECORDED else f"{self.name}_future{future:04d}"

    def states(self, future: int) -> States:
        """Return the states (V, T) of a future from the first logged frame on."""
        return self._recorded[0] if future == RECORDED else self.run.states(future)

    def models_of(self, future: int) -> list[str]:
        """Return the model (V,) of each vehicle of a future."""
        return ["recorded"] * self.scene.vehicles if future == RECORDED else self.run.models_of(future)

    @cached_property
    def _recorded(self) -> tuple[States, BoolArray]:
        """The recorded future, for as many steps as the run has, and whether a vehicle is there, (V, T)."""
        scene, steps = self.scene, int(self.run.info["steps"])
        if scene.future is None or scene.future_valid is None:
            raise UsageError(f"--recorded: the seed scene {self.name} has no recorded future")
        logged = scene.history[:, -LOGGED_HISTORY:]
        there = np.ones(logged.shape, dtype=np.bool_)
        states = States.concatenate([logged, scene.future[:, :steps]], 1)
        return states, np.concatenate([there, scene.future_valid[:, :steps]], axis=1)

    def file(self, stem: str, ending: str) -> Path:
        """Return the file ``out``, else one named by a stem; its folder is made if missing.

        An ``out`` without an ending is a folder.
        """
        name = f"{stem}{ending}"
        path = self.out or Path(name)
        if self.out is not None and (path.is_dir() or not path.suffix):
            path /= name
        path.parent.mkdir(parents=True, exist_ok=True)
        return path

    def files(self, ending: str) -> list[Path]:
        """Return the file of each future: ``out`` for one future, else files in the folder ``out``."""
        if len(self.futures) == 1:
            return [self.file(self.file_stem(self.futures[0]), ending)]
        return [self.folder / f"{self.file_stem(future)}{ending}" for future in self.futures]

    def write_each(self, ending: str, content: Callable[[int], bytes]) -> list[Path]:
        """Write and return the `files` of all futures."""
        paths = self.files(ending)
        for future, path in zip(self.futures, paths, strict=True):
            self.write(path, content(future))
        return paths

    def write(self, path: Path, content: bytes) -> None:
        """Write a file, unless it is an input of the run or a file of others."""
        with self.output(path) as temporary:
            temporary.write_bytes(content)

    def output(self, path: Path) -> AbstractContextManager[Path]:
        """Yield a temporary file that becomes a file as of `write`."""
        return output(path, *self.inputs)

    @property
    def inputs(self) -> list[Path]:
        """Map and tracks of the run."""
        scene = self.run.info["seed_scene"]
        named = (scene.get("map"), (scene.get("source") or {}).get("tracks"))
        return [Path(file) for file in named if file]

    def ego_index(self) -> int | None:
        """Return the index of the ego in the seed scene, None without an ego."""
        if self.ego is None:
            return None
        ids = self.scene.track_ids.tolist()
        if self.ego not in ids:
            vehicles = ", ".join(map(str, ids))
            raise UsageError(f"--ego {self.ego}: not in the seed scene; its vehicles: {vehicles}")
        return int(ids.index(self.ego))

    def participants(self, future: int) -> Iterator[Participant]:
        """Yield the vehicles of a future, then the pedestrians and cyclists that are there at some time."""
        scene, states = self.scene, self.states(future)

        def participant(users: SeedScene | Obstacles, k: int, track: States, there: BoolArray) -> Participant:
            own: dict[str, Any] = {"index": k, "states": track, "present": there, "kind": users.types[k]}
            if isinstance(users, SeedScene):
                own |= {"label": int(users.track_ids[k]), "name": users.names[k], "vehicle": k}
            else:
                own |= {"label": users.ids[k], "name": str(users.ids[k]), "vehicle": None}
            return Participant(length=float(users.length[k]), width=float(users.width[k]), **own)

        there = self._recorded[1] if future == RECORDED else np.isfinite(states.x)
        for v in range(scene.vehicles):
            yield participant(scene, v, states[v], there[v])
        if (others := scene.obstacles) is not None:
            frames = slice(1, 1 + states.shape[1])  # their second frame is the first one of a future
            for o in np.flatnonzero(others.present[:, frames].any(axis=1)).tolist():
                yield participant(others, o, others.states[o, frames], others.present[o, frames])
