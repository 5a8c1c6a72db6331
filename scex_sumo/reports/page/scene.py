"""Road as SVG paths, tracks of all children as integers, and a picture of both."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scex_sumo.base.arrays import FloatArray, IntArray
from scex_sumo.reports.page.html import Html, element
from scex_sumo.reports.page.packing import quantized, second_differences, second_sums
from scex_sumo.results.run import Run
from scex_sumo.scene import LOGGED_HISTORY, States
from scex_sumo.views.road_lines import AREA, SURFACE, RoadLine

POSITION_M, HEADING_RAD, SPEED_MPS = 0.01, 0.001, 0.02
_ROAD_UNIT_M = 0.05
_MARGIN_M = 12.0
_MIN_ASPECT = 0.55  # of the picture's sides, either way


@dataclass(frozen=True, kw_only=True, eq=False)
class UniqueTracks:
    """Different trajectories of a run, each stored once.

    Attributes:
        start: (V, 4) x and y in cm, heading in mrad, speed in 2 cm/s, at the seed moment.
        motion: (U, T, 4) second differences of the change since then, ordered by vehicle.
        which: (C, V) rows of ``motion``.
        box: least and largest x, least and largest y after that moment, m.
    """

    start: IntArray
    motion: IntArray
    which: IntArray
    box: tuple[float, float, float, float]


def unique_tracks(run: Run) -> UniqueTracks:
    """Return the trajectories of a run from its seed moment on."""
    vehicles = len(run.info["seed_scene"]["track_ids"])
    start = np.empty((0, 4), dtype=np.int64)
    # By vehicle: the different motions of each block, and their index for each child.
    motions: list[list[IntArray]] = [[] for _ in range(vehicles)]
    places: list[list[IntArray]] = [[] for _ in range(vehicles)]
    for states in run.state_blocks():
        poses = _poses(states)[:, :, LOGGED_HISTORY - 1 :]
        start = start if len(start) else poses[0, :, 0]
        moved = np.ascontiguousarray((poses[:, :, 1:] - start[:, None]).astype(np.int32).swapaxes(0, 1))
        for vehicle, rows in enumerate(moved):
            unique, place = _unique_rows(rows)
            places[vehicle].append(place + sum(map(len, motions[vehicle])))
            motions[vehicle].append(unique)
    which = np.empty((run.children, vehicles), dtype=np.int64)
    parts: list[IntArray] = []
    for vehicle in range(vehicles):
        unique, place = _unique_rows(np.concatenate(motions[vehicle]))
        which[:, vehicle] = place[np.concatenate(places[vehicle])] + sum(map(len, parts))
        parts.append(unique)
    lows, highs = (np.stack([end(part, axis=(0, 1)) for part in parts]) + start for end in (np.min, np.max))
    (left, low), (right, high) = lows[:, :2].min(axis=0).tolist(), highs[:, :2].max(axis=0).tolist()
    box = (left * POSITION_M, right * POSITION_M, low * POSITION_M, high * POSITION_M)
    motion = second_differences(np.concatenate(parts))
    return UniqueTracks(start=start, motion=motion, which=which, box=box)


def _unique_rows(rows: IntArray) -> tuple[IntArray, IntArray]:
    """Return the different rows (U, T, 4), and the index of each row among them."""
    rows = np.ascontiguousarray(rows)
    keys = rows.reshape(len(rows), -1).view(np.dtype((np.void, rows[0].nbytes))).reshape(-1)
    _, first, inverse = np.unique(keys, return_index=True, return_inverse=True)
    return rows[first], inverse.reshape(-1)


def recorded_tracks(states: States, start: IntArray) -> IntArray:
    """Return recorded (V, F) states as second differences (V, F, 4) of the change since the start."""
    return second_differences(_poses(states) - start[:, None])


def _poses(states: States) -> IntArray:
    heading = np.unwrap(states.heading)
    parts = (
        (states.x, POSITION_M),
        (states.y, POSITION_M),
        (heading, HEADING_RAD),
        (states.speed, SPEED_MPS),
    )
    return np.stack([quantized(values, unit) for values, unit in parts], axis=-1)


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
    whole = quantized(points, _ROAD_UNIT_M)
    first, steps = whole[0], np.diff(whole, axis=0)
    return f"M{first[0]} {first[1]}l" + " ".join(f"{x} {y}" for x, y in steps.tolist())


def scene_svg(info: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> Html:
    """Return a picture of the road, the vehicles and the paths of their children.

    Args:
        info: of `report_contents`.
        arrays: of `report_contents`.
    """
    left, right, low, high = info["box"]
    wide, tall = right - left + 2 * _MARGIN_M, high - low + 2 * _MARGIN_M
    wide, tall = max(wide, _MIN_ASPECT * tall), max(tall, _MIN_ASPECT * wide)
    x, y = (left + right - wide) / 2, -(low + high + tall) / 2
    parts = [_road_svg(group) for group in info["road"]]
    parts += _paths_svg(info, arrays)
    parts += [_vehicle_svg(pose, size) for pose, size in zip(arrays["start"], info["sizes"], strict=True)]
    upwards = element("g", *parts, transform="scale(1 -1)")
    view = f"{x:.1f} {y:.1f} {wide:.1f} {tall:.1f}"
    return element("svg.scene", upwards, viewBox=view, role="img", aria_label=info["name"])


def _road_svg(group: Mapping[str, Any]) -> Html:
    kind = {SURFACE: "lane", AREA: "junction"}.get(group["kind"], "marking")
    width = f"{(group['width'] or 0.15) / _ROAD_UNIT_M:g}"
    return element(f"path.{kind}", d=group["path"], stroke_width=width, transform=f"scale({_ROAD_UNIT_M})")


def _paths_svg(info: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> list[Html]:
    which, levels = arrays["which"], arrays["levels"]
    rows, first = np.unique(which, return_index=True)
    moved = second_sums(arrays["motion"])[rows][:, ::3, :2] * POSITION_M
    starts = arrays["start"][first % which.shape[1], :2] * POSITION_M
    paths = []
    for line, start, model in zip(moved, starts, levels.reshape(-1)[first], strict=True):
        points = np.concatenate([start[None], start + line])
        d = "M" + " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
        paths.append(element("path.way", d=d, stroke=info["colors"][model]))
    return paths


def _vehicle_svg(pose: NDArray[Any], size: tuple[float, float]) -> Html:
    (x, y), (length, width) = pose[:2] * POSITION_M, size
    turn = f"translate({x:.2f} {y:.2f}) rotate({np.degrees(pose[2] * HEADING_RAD):.1f})"
    box = {"x": f"{-length / 2:.2f}", "y": f"{-width / 2:.2f}", "width": f"{length:.2f}"}
    return element("rect.vehicle", height=f"{width:.2f}", transform=turn, **box)
