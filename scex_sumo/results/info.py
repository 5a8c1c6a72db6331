"""Contents of ``run.json``: checked, because files are edited; its seed scene and versions of packages."""

from __future__ import annotations

import hashlib
import json
import math
import platform
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa

from scex_sumo.base.errors import ResultError, reason_of
from scex_sumo.base.files import refuse_special_files
from scex_sumo.base.version import version_of
from scex_sumo.scene import SeedScene

MAX_COUNT: Final = 10**9
"""Limit of numbers of futures, steps and vehicles."""


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
    try:
        refuse_special_files(folder)
        content = json.loads(file.read_bytes())
    except (ValueError, RecursionError) as error:
        raise ResultError(f"{file}: not JSON: {str(error)[:120]}; run again") from None
    except OSError as error:
        raise ResultError(f"{file}: cannot be read: {error.strerror or error}") from None
    if not isinstance(content, dict):
        raise ResultError(f"{file}: holds no object; run again")
    if "children" in content:
        raise ResultError(f"{file}: of a version whose results have other names; run the same command again")
    info = Info(content, file)
    for key, fits in _CHECKS.items():
        holder, _, name = key.rpartition(".")
        values = info.get(holder, {}) if holder else info
        if not isinstance(values, dict) or (name in values and not fits(values[name])):
            got = json.dumps(values[name] if isinstance(values, dict) else values)[:40]
            raise ResultError(f"{file}: {key} is {got}; it was edited or is of another program: run again")
    scene = info.get("seed_scene", {})
    if len(scene.get("track_ids", ())) not in (0, scene.get("vehicles")):
        raise ResultError(f"{file}: has not as many track_ids as vehicles; it was edited: run again")
    return info


def _is_count(value: Any) -> bool:
    return type(value) is int and 0 <= value < MAX_COUNT


def _is_name(value: Any) -> bool:
    return isinstance(value, str) and value not in ("", ".", "..") and "/" not in value and "\0" not in value


def _is_ids(value: Any) -> bool:
    return (
        isinstance(value, list)
        and all(type(i) is int and abs(i) < 2**63 for i in value)
        and len(set(value)) == len(value)
    )


def _is_numbers(value: Any) -> bool:
    return isinstance(value, dict) and all(
        type(v) in (int, float) and math.isfinite(v) for v in value.values()
    )


def _is_tracks(value: Any) -> bool:
    return isinstance(value, dict) and all(k.removeprefix("-").isdecimal() for k in value)


def _is_texts(value: Any) -> bool:
    return isinstance(value, list) and all(isinstance(text, str) for text in value)


def _is_metrics(value: Any) -> bool:
    return isinstance(value, list) and all(
        isinstance(m, dict)
        and all(isinstance(m.get(key, ""), str) for key in ("label", "unit"))
        and isinstance(m.get("name"), str)
        and m.get("critical") in ("min", "max")
        for m in value
    )


_CHECKS: Final[dict[str, Callable[[Any], bool]]] = {
    "futures": _is_count,
    "steps": _is_count,
    "replan": _is_count,
    "net": _is_name,
    "thresholds": _is_numbers,
    "under_test": _is_tracks,
    "metrics": _is_metrics,
    "net_notes": _is_texts,
    "run_notes": _is_texts,
    "models": lambda value: isinstance(value, list),
    "seed_scene": lambda value: isinstance(value, dict),
    "seed_scene.name": _is_name,
    "seed_scene.vehicles": _is_count,
    "seed_scene.track_ids": _is_ids,
}


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
        **({} if scene.people is None else {"people": scene.track_ids[scene.people].tolist()}),
        "recorded_future_steps": int(scene.future.shape[1]) if scene.future is not None else 0,
        "notes": list(scene.notes),
        "source": scene.source,
        "map": None if scene.road is None or scene.road.file is None else str(scene.road.file.absolute()),
        "origin": list(scene.road.origin) if scene.road is not None else None,
        "fingerprint": digest(scene),
    }


def versions() -> dict[str, str]:
    """Return the versions of the packages that the numbers depend on."""
    names = ("libsumo", "eclipse-sumo", "lanelet2", "numpy", "scipy", "shapely", "pyarrow")
    return {"python": platform.python_version(), **{n: version_of(n) for n in names}}
