"""Road as SVG paths, and tracks of all futures as integers."""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from operator import itemgetter
from typing import Any, TypeAlias

import numpy as np

from scex_sumo.base.arrays import FloatArray, IntArray, distinct
from scex_sumo.converters.net.reading import AREA, RoadLine
from scex_sumo.page.packing import UNITS, coded_motion, quantized, smallest
from scex_sumo.results.run import Run
from scex_sumo.scene import LOGGED_HISTORY, States

FAR_M = 1e6  # place of vehicles that have left
ROAD_UNIT_M = 0.05
_BUDGET = 280_000  # bytes of packed tracks; a page takes a third more, because it is text
_SAMPLED = 400  # tracks whose packed size stands for all
_MAX_FUTURES = 1000

Box: TypeAlias = tuple[float, float, float, float]
Future: TypeAlias = tuple[Run, int, int]
"""A run, its future, and the number of this future on the page."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PackedTracks:
    """Tracks of the futures that a page can show, each stored once.

    Attributes:
        futures: (P,) numbers, ascending.
        which: (P, V) column of ``motion``, counted from the vehicle's first one.
        start: (V, 4) x, y, heading, speed at the seed moment, in `UNITS`.
        motion: (4, U, T) as of `coded_motion`, ordered by vehicle and first future.
        owner: (U,) vehicles.
        box: least and largest x, least and largest y, m.
    """

    futures: IntArray
    which: IntArray
    start: IntArray
    motion: IntArray
    owner: IntArray
    box: tuple[float, float, float, float]


def packed_tracks(wanted: Sequence[Future], *, budget: int = _BUDGET) -> PackedTracks:
    """Return the tracks of the first futures of a list that take no more than ``budget`` bytes, at least one.

    Futures without a noise of their own share most tracks; of those with noise a page holds a sample.
    """
    wanted = wanted[:_MAX_FUTURES]
    read: dict[int, FloatArray] = {}
    for run, future, number in sorted(wanted, key=itemgetter(2)):  # row groups of a file in order
        read[number] = poses_of(run.states(future)[:, LOGGED_HISTORY - 1 :])
    poses = np.stack([read[number] for _, _, number in wanted])
    start = quantized(poses[0, :, 0], np.array(UNITS))
    which, first, owner = _different(quantized(poses, np.array(UNITS)))
    sample = slice(None, None, max(1, len(owner) // _SAMPLED))
    codes = coded_motion(start[owner[sample]], poses[first[sample], owner[sample], 1:])
    packed = len(zlib.compress(smallest(codes).tobytes())) / codes.shape[1]
    kept = np.maximum.accumulate(which.max(axis=1)) < max(budget / packed, which[0].max() + 1)
    futures = np.array([number for _, _, number in wanted])[kept]
    order_of = np.argsort(futures)
    used, since = np.unique(which[kept][order_of], return_index=True)
    order = used[np.lexsort((since, owner[used]))]
    place = np.empty(len(owner), dtype=np.int64)
    place[order] = np.arange(len(order)) - np.searchsorted(owner[order], owner[order])
    seen = poses[kept][..., :2]
    seen = seen[seen[..., 0] < FAR_M / 2]
    (left, low), (right, high) = seen.min(axis=0).tolist(), seen.max(axis=0).tolist()
    return PackedTracks(
        futures=futures[order_of],
        which=place[which[kept][order_of]],
        start=start,
        motion=coded_motion(start[owner[order]], poses[first[order], owner[order], 1:]),
        owner=owner[order],
        box=(left, right, low, high),
    )


def _different(poses: IntArray) -> tuple[IntArray, IntArray, IntArray]:
    """Return (P, V) the track of each vehicle, and of each different track (U,) its future and vehicle."""
    futures, vehicles = poses.shape[:2]
    owner = np.tile(np.arange(vehicles), futures)
    tracks = np.column_stack([owner, poses.reshape(len(owner), -1)])
    first, which = distinct(tracks)
    return which.reshape(futures, vehicles), first // vehicles, owner[first]


def poses_of(states: States) -> FloatArray:
    """Return (V, T, 4) x, y, heading without jumps and speed, far away where they are unknown."""
    poses = np.stack([states.x, states.y, np.unwrap(states.heading), states.speed], axis=-1)
    return np.where(np.isnan(poses), FAR_M, poses)


def road_paths(lines: Iterable[RoadLine]) -> list[dict[str, Any]]:
    """Return the lines of a road, the lower ones first.

    Returns:
        ``kind``, ``width`` in m, and ``path`` as SVG writes it, in units of 5 cm. Lines of one kind and width
        share a path; each area has its own.
    """
    groups: dict[tuple[int, float, int], list[str]] = {}
    for number, (kind, width, points) in enumerate(lines):
        groups.setdefault((kind, width, number if kind == AREA else -1), []).append(_path(points))
    order = sorted(groups.items(), key=lambda item: item[0])
    return [{"kind": kind, "width": width, "path": "".join(paths)} for (kind, width, _), paths in order]


def _path(points: FloatArray) -> str:
    whole = quantized(points, ROAD_UNIT_M)
    first, steps = whole[0], np.diff(whole, axis=0)
    return f"M{first[0]} {first[1]}l" + " ".join(f"{x} {y}" for x, y in steps.tolist())
