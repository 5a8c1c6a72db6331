"""Seed scene of a command, and notes on it for the reader."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from scex_sumo.commands import console
from scex_sumo.commands.console import progress_bar, warn

if TYPE_CHECKING:
    from scex_sumo.scenarios.seeds import SeedOptions
    from scex_sumo.scene import SeedScene

_LONG = 200


def seed_scene(map_path: Path, options: SeedOptions, *, seed: int, cache: bool = True) -> SeedScene:
    """Read or populate the seed scene; its notes go to standard error.

    Raises:
        TrackError: over half of the vehicles are on no mapped lane.
        ScexError: map or tracks cannot be read.
    """
    from scex_sumo.converters.datasets.interaction import beside_tracks

    if map_path.is_dir():
        from scex_sumo.converters.datasets.find import map_and_tracks

        map_path, tracks = map_and_tracks(map_path, options.tracks)
        if tracks != options.tracks and options.synthetic is None:
            options = replace(options, tracks=tracks)
    scene = (_recorded if options.synthetic is None else _populated)(map_path, options, seed, cache)
    assert scene.road is not None
    warn(_brief(note) for note in (*scene.road.notes, *scene.notes))
    recorded = options.tracks is None and options.synthetic is None
    if recorded and (others := beside_tracks(map_path)):
        warn([f"recordings of this map besides the one taken: {others}; choose one with --tracks"])
    return scene


def _recorded(map_path: Path, options: SeedOptions, seed: int, cache: bool) -> SeedScene:
    from scex_sumo.converters.registries import dataset_of
    from scex_sumo.scenarios.seeds import read_seed

    simulated = options.tracks is None and dataset_of(map_path).simulated
    with progress_bar(f"simulating {map_path.name}") if simulated else nullcontext() as tick:
        return read_seed(
            map_path,
            tracks=options.tracks,
            case=options.case,
            time=options.time,
            origin=_origin(options),
            cache=cache,
            progress=tick,
        )


def _populated(map_path: Path, options: SeedOptions, seed: int, cache: bool) -> SeedScene:
    from scex_sumo.generators.synthetic import synthetic_seed

    assert options.synthetic is not None
    with progress_bar(f"populating {map_path.name}") as tick:
        return synthetic_seed(
            map_path,
            vehicles=options.synthetic,
            like=options.like or "sumo",
            seed=seed,
            origin=_origin(options),
            cache=cache,
            progress=tick,
        )


def _origin(options: SeedOptions) -> tuple[float, float] | None:
    from scex_sumo.converters.lanelet.origin import parse_origin

    return None if options.origin is None else parse_origin(options.origin)


def _brief(note: str) -> str:
    """Return the first two findings of a long note; ``run.json`` has the rest."""
    first, second, *others = [*note.split("; "), ""] if console.level <= 0 else [note, ""]
    return f"{first}; {second}; {len(others) - 1} more in run.json" if others and len(note) > _LONG else note
