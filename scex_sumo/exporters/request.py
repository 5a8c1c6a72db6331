"""Export request: which children of a run are written where, and what exporters need to know of them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from scex_sumo.errors import MapError, UsageError
from scex_sumo.geometry.rectangles import Rectangles, rectangle_distance
from scex_sumo.results.run import Run
from scex_sumo.road import Road
from scex_sumo.scene import LOGGED_HISTORY, SeedScene, States
from scex_sumo.views.children import most_critical


@dataclass(frozen=True, kw_only=True)
class Request:
    """What an exporter is asked for.

    Attributes:
        run: the finished run.
        children: numbers of the children, at least one.
        out: file or folder to write; None leaves the name to the exporter.
        ego: track id of the vehicle whose task it is to plan, where a format has one.
        critical: metric by which the children were chosen, or None.
        encounter: vehicles by whose encounter they were chosen, or None.
        map_path: the map of the run; None takes that of its ``run.json``.
    """

    run: Run
    children: tuple[int, ...]
    out: Path | None = None
    ego: int | None = None
    critical: str | None = None
    encounter: tuple[int, int] | None = None
    map_path: Path | None = None

    @property
    def name(self) -> str:
        """Name of the seed scene."""
        return str(self.run.info["seed_scene"]["name"])

    @cached_property
    def scene(self) -> SeedScene:
        """The seed scene."""
        return self.run.scene

    @cached_property
    def road(self) -> Road:
        """The map, read again.

        Raises:
            MapError: it is not where it was, or is another one.
        """
        from scex_sumo.converters.maps import read_map

        known = self.run.info["seed_scene"].get("map")
        path = self.map_path or (Path(known) if known else None)
        if path is None or not path.exists():
            where = "its path is not in run.json" if path is None else f"{path}: no such file"
            raise MapError(f"{self.run.folder}: the map is not found ({where}); give it with --map MAP")
        origin = self.run.info["seed_scene"].get("origin")
        road = read_map(path, origin=tuple(origin) if origin else None)
        if road.name != self.run.info["net"]:
            raise MapError(f"{path}: not the map of {self.run.folder}, which is {self.run.info['net']}")
        return replace(road, origin=tuple(origin)) if origin else road

    @cached_property
    def folder(self) -> Path:
        """The folder to write, made if need be."""
        path = self.out if self.out is not None else Path(f"{self.name}_export")
        if path.exists() and not path.is_dir():
            raise UsageError(f"-o {path}: this format needs a folder, and that is a file")
        path.mkdir(parents=True, exist_ok=True)
        return path

    def file_stem(self, child: int) -> str:
        """Name of a child's file without its ending."""
        return f"{self.name}_child{child:04d}"

    def ego_index(self) -> int | None:
        """Number of the ego in the seed scene, or None where none is asked for.

        Raises:
            UsageError: it is not in the seed scene.
        """
        if self.ego is None:
            return None
        found = np.flatnonzero(self.scene.track_ids == self.ego)
        if not len(found):
            ids = ", ".join(map(str, self.scene.track_ids))
            raise UsageError(f"--ego {self.ego}: not in the seed scene; its vehicles: {ids}")
        return int(found[0])

    def obstacle_frames(self) -> slice:
        """Frames of the obstacles that are a child's: the second of their states is its frame 1."""
        return slice(1, 1 + LOGGED_HISTORY + int(self.run.info["steps"]))


def critical_children(run: Run, column: str, count: int) -> tuple[int, ...]:
    """The children with the most critical values of a metric, the worst first.

    Raises:
        UsageError: there is no such metric, or it is defined in none of the children.
    """
    try:
        column = run.column(column)
    except UsageError:
        raise UsageError(f"--critical {column}: unknown metric; known: {', '.join(run.columns)}") from None
    order = most_critical(run, run.children, column)
    defined = order[~np.isnan(run.values(column)[order])][:count]
    if not len(defined):
        raise UsageError(f"--critical {column}: defined in none of {run.children} children")
    return tuple(int(run.metrics["child"][int(i)].as_py()) for i in defined)


def closest_encounters(run: Run, first: int, second: int, count: int) -> tuple[int, ...]:
    """The children in which two vehicles come closest to each other after the seed scene, closest first.

    Raises:
        UsageError: one of them is not in the seed scene.
    """
    scene = run.scene
    ids = scene.track_ids.tolist()
    for track in (first, second):
        if track not in ids:
            raise UsageError(
                f"--encounter {first},{second}: no vehicle {track}; known: {', '.join(map(str, ids))}"
            )
    pair = [ids.index(first), ids.index(second)]
    gaps = [_least_gap(scene, run.states(child), pair) for child in range(run.children)]
    return tuple(int(child) for child in np.argsort(gaps, kind="stable")[:count])


def _least_gap(scene: SeedScene, states: States, pair: list[int]) -> float:
    ways = states[:, LOGGED_HISTORY:]
    one, two = (Rectangles.of(ways[v], scene.length[v], scene.width[v]) for v in pair)
    return float(rectangle_distance(one, two).min())
