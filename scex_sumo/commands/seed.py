"""Seed scene of a command, and notes on it for the reader."""

from __future__ import annotations

import math
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING

from scex_sumo.base.errors import UsageError
from scex_sumo.commands import console
from scex_sumo.commands.console import progress_bar, warn

if TYPE_CHECKING:
    from scex_sumo.scene import SeedScene

_LONG = 200


def seed_scene(
    map_path: Path,
    *,
    tracks: Path | None,
    case: str | None,
    time: float | None,
    synthetic: int | None,
    origin: str | None,
    seed: int,
    cache: bool = True,
    force: bool = False,
    like: str | None = None,
    speed: float | None = None,
) -> SeedScene:
    """Read or populate the seed scene; its notes go to standard error.

    Raises:
        UsageError: options exclude one another.
        TrackError: over half of the vehicles are on no mapped lane, without ``force``.
        ScexError: map or tracks cannot be read.
    """
    from scex_sumo.converters.datasets.find import beside_tracks
    from scex_sumo.converters.lanelet.origin import parse_origin
    from scex_sumo.converters.registries import dataset_of
    from scex_sumo.scenarios.seeds import read_seed, synthetic_seed

    if time is not None and not math.isfinite(time):
        raise UsageError(f"--time {time}: needs a moment in seconds")
    zero = parse_origin(origin) if origin is not None else None
    if like is not None and synthetic is None:
        raise UsageError("--as: needs --synthetic N")
    if speed is not None and synthetic is None:
        raise UsageError("--speed: needs --synthetic N --as recorded")
    if synthetic is None:
        simulated = tracks is None and dataset_of(map_path).simulated
        shown = progress_bar(f"simulating {map_path.name}") if simulated else nullcontext()
        with shown as tick:
            scene = read_seed(
                map_path,
                tracks=tracks,
                case=case,
                time=time,
                origin=zero,
                cache=cache,
                force=force,
                progress=tick,
            )
    else:
        options = {"--tracks": tracks, "--case": case, "--time": time}
        given = [name for name, value in options.items() if value is not None]
        if given:
            raise UsageError(f"--synthetic: makes its own tracks; leave out {', '.join(given)}")
        with progress_bar(f"populating {map_path.name}") as tick:
            scene = synthetic_seed(
                map_path,
                vehicles=synthetic,
                like=like or "sumo",
                speed=speed,
                seed=seed,
                origin=zero,
                cache=cache,
                progress=tick,
            )
    assert scene.road is not None
    warn(_brief(note) for note in (*scene.road.notes, *scene.notes))
    if tracks is None and synthetic is None and (others := beside_tracks(map_path)):
        warn([f"recordings of this map besides the one taken: {others}; choose one with --tracks"])
    return scene


def _brief(note: str) -> str:
    """Return the first finding of a long note; ``run.json`` has the rest."""
    first, *others = note.split("; ") if console.level <= 0 else [note]
    return f"{first}; {len(others)} more in run.json" if others and len(note) > _LONG else note


def one_source(tracks: Path | None, fcd: Path | None, state: Path | None) -> Path | None:
    """Return the tracks of ``--tracks``, ``--fcd`` or ``--state``; a `UsageError` for several of them."""
    given = {"--tracks": tracks, "--fcd": fcd, "--state": state}
    named = [name for name, path in given.items() if path is not None]
    if len(named) > 1:
        raise UsageError(f"{' and '.join(named)} exclude one another; give one of them")
    return given[named[0]] if named else None
