"""Contents of ``run.json``: checked, because files are edited; its seed scene and versions of packages."""

from __future__ import annotations

import hashlib
import platform
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa

from scex_sumo.base.errors import ResultError, reason_of
from scex_sumo.base.files import refuse_special_files
from scex_sumo.base.schema import COUNT, NUMBER, PLAIN_NAME, TEXT, TRACK, listed, or_null, read_json, record
from scex_sumo.base.version import version_of
from scex_sumo.converters.tracks.road_users import road_user
from scex_sumo.scene import SeedScene

PAGE: Final = "report.html"
BASELINE: Final = "baseline"
REFERENCE: Final = "reference"
"""Folders in that of a run, with results of their own."""


class Info(dict[str, Any]):
    """JSON object; a missing key is an error that names the file."""

    def __init__(self, content: Mapping[str, Any], file: Path) -> None:
        super().__init__({k: Info(v, file) if isinstance(v, dict) else v for k, v in content.items()})
        self._file = file

    def __missing__(self, key: str) -> Any:
        raise ResultError(f"{self._file}: has no {key!r}; it was edited or is of another program: run again")


@contextmanager
def as_written(*folders: Path) -> Iterator[None]:
    """Turn errors over inconsistent files of result folders into a `ResultError`."""
    try:
        yield
    except (ValueError, LookupError, TypeError, ArithmeticError, SyntaxError, pa.ArrowException) as error:
        where = ", ".join(str(folder) for folder in folders)
        raise ResultError(
            f"{where}: its files do not fit together ({reason_of(error)[:120]}); they were edited: run again"
        ) from error


def read_info(folder: Path) -> Info:
    """Read ``run.json`` of a finished run; raise a `ResultError` if no run wrote it."""
    file = folder / "run.json"
    if not file.is_file():
        if (folder / "incomplete.json").is_file():
            raise ResultError(f"{folder}: the run was interrupted; the same command resumes it")
        missing = "no such folder" if not folder.exists() else "no run.json in it"
        raise ResultError(f"{folder}: {missing}; give the folder that 'scex-sumo run -o' wrote")
    refuse_special_files(folder)
    content = read_json(file, _RUN, "it was edited or is of another program: run again")
    if "children" in content:
        raise ResultError(f"{file}: of a version whose results have other names; run the same command again")
    info = Info(content, file)
    scene = info.get("seed_scene", {})
    tracks = scene.get("track_ids", ())
    if len(tracks) not in (0, scene.get("vehicles")) or len({*tracks}) < len(tracks):
        raise ResultError(f"{file}: track_ids are not one for each of the vehicles; it was edited: run again")
    return info


_METRIC = record(
    {"name": TEXT, "critical": {"enum": ["min", "max"]}},
    {
        **dict.fromkeys(("label", "unit"), TEXT),
        **{name: {"type": "boolean"} for name in ("inverse", "finite", "harmonic", "pairwise")},
        "threshold": or_null(NUMBER),
    },
)
_SEED_SCENE = {"name": PLAIN_NAME, "vehicles": COUNT, "track_ids": listed(TRACK)}
_RUN: Final = record(
    {},
    {
        **dict.fromkeys(("futures", "steps", "replan"), COUNT),
        "net": PLAIN_NAME,
        "thresholds": {"type": "object", "additionalProperties": NUMBER},
        "under_test": {"type": "object", "propertyNames": {"pattern": r"^-?\d+$"}},
        "metrics": listed(_METRIC),
        **dict.fromkeys(("net_notes", "run_notes"), listed(TEXT)),
        "models": {"type": "array"},
        "seed_scene": record({}, _SEED_SCENE),
    },
)


def digest(scene: SeedScene) -> str:
    """Return the SHA-256 of everything in a seed scene that its futures depend on."""
    digest = hashlib.sha256()
    for array in (scene.track_ids, scene.length, scene.width):
        digest.update(np.ascontiguousarray(array).tobytes())
    for states in (scene.history, scene.future, scene.obstacles.states if scene.obstacles else None):
        if states is not None:
            for array in (states.x, states.y, states.heading, states.speed):
                digest.update(np.ascontiguousarray(array).tobytes())
    digest.update(repr(scene.types).encode())
    if scene.obstacles is not None and scene.obstacles.walks:
        digest.update(repr(scene.obstacles.walks).encode())
    for intention in scene.intentions:
        known = None if intention is None else {**vars(intention), "lanes": sorted(intention.lanes)}
        digest.update(repr(known).encode())
    for lane in scene.road.lanes.values() if scene.road is not None else ():
        digest.update(repr((lane.lane_id, lane.kind, lane.speed_limit_mps, lane.successors)).encode())
        digest.update(np.ascontiguousarray(lane.centreline).tobytes())
    return digest.hexdigest()


def describe(scene: SeedScene) -> dict[str, Any]:
    """Return the seed scene's entry of ``run.json``."""
    return {
        "name": scene.name,
        "location": scene.location,
        "time_s": scene.time_s,
        "vehicles": scene.vehicles,
        "track_ids": [int(t) for t in scene.track_ids],
        "obstacles": len(scene.obstacles.ids) if scene.obstacles is not None else 0,
        "replayed": {} if scene.obstacles is None else Counter(map(road_user, scene.obstacles.types)),
        **({} if scene.people is None else {"people": scene.track_ids[scene.people].tolist()}),
        "notes": list(scene.notes),
        "source": scene.source,
        "map": None if scene.road is None or scene.road.file is None else str(scene.road.file.absolute()),
        "origin": list(scene.road.origin) if scene.road is not None else None,
    }


def versions() -> dict[str, str]:
    """Return the versions of the packages that the numbers depend on."""
    names = ("libsumo", "eclipse-sumo", "lanelet2", "numpy", "scipy", "shapely", "pyarrow")
    return {"python": platform.python_version(), **{n: version_of(n) for n in names}}
