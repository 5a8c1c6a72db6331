"""Chunks of CommonRoad recordings, ``SCENE_FIRST_T-LAST.xml``."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

from scex_sumo.converters.naming import map_name

_CHUNK = re.compile(r"(?P<scene>.+)_(?P<first>\d+)_T-(?P<last>\d+)")


def commonroad_chains(paths: Iterable[Path]) -> list[tuple[Path, ...]]:
    """CommonRoad files by recording: single files, then consecutive chunks ``SCENE_FIRST_T-LAST``."""
    alone: list[tuple[Path, ...]] = []
    chunks = []
    for path in sorted(paths):
        span = chunk_span(path)
        if span is None:
            alone.append((path,))
        else:
            chunks.append((path.parent, *span, path))
    joined: list[list[Path]] = []
    expected = None
    for folder, scene, first, last, path in sorted(chunks):
        if expected == (folder, scene, first):
            joined[-1].append(path)
        else:
            joined.append([path])
        expected = folder, scene, last + 1
    return alone + [tuple(files) for files in joined]


def chunk_span(path: Path) -> tuple[str, int, int] | None:
    """Scene, first and last step of a chunk of a CommonRoad recording, by its name; else None."""
    parts = _CHUNK.fullmatch(map_name(path))
    if parts is None or int(parts["last"]) <= int(parts["first"]):
        return None
    return parts["scene"], int(parts["first"]), int(parts["last"])
