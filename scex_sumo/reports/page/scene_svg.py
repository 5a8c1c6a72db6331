"""Picture of a report's scene, as SVG: the road, the vehicles, and where its children go."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scex_sumo.reports.page.html import Html, element
from scex_sumo.reports.page.packing import second_sums
from scex_sumo.reports.page.road_lines import UNIT_M
from scex_sumo.reports.page.tracks import HEADING_RAD, POSITION_M
from scex_sumo.views.road_lines import AREA, SURFACE

_MARGIN_M = 12.0
_SQUARE = 0.55
"""Least height of the picture as a share of its width, and the other way round."""


def scene_svg(info: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> Html:
    """The picture, from what `report_contents` says."""
    left, right, low, high = info["box"]
    wide, tall = right - left + 2 * _MARGIN_M, high - low + 2 * _MARGIN_M
    wide, tall = max(wide, _SQUARE * tall), max(tall, _SQUARE * wide)
    x, y = (left + right - wide) / 2, -(low + high + tall) / 2
    parts = [_road(group) for group in info["road"]]
    parts += _paths(info, arrays)
    parts += [_vehicle(pose, size) for pose, size in zip(arrays["start"], info["sizes"], strict=True)]
    upwards = element("g", *parts, transform="scale(1 -1)")
    view = f"{x:.1f} {y:.1f} {wide:.1f} {tall:.1f}"
    return element("svg.scene", upwards, viewBox=view, role="img", aria_label=info["name"])


def _road(group: Mapping[str, Any]) -> Html:
    kind = {SURFACE: "lane", AREA: "junction"}.get(group["kind"], "marking")
    width = f"{(group['width'] or 0.15) / UNIT_M:g}"
    scale = f"scale({UNIT_M})"
    return element(f"path.{kind}", d=group["path"], stroke_width=width, transform=scale)


def _paths(info: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> list[Html]:
    """One line for each different trajectory, in the colour of one of those who drive it."""
    which, levels = arrays["which"], arrays["levels"]
    rows, first = np.unique(which, return_index=True)
    moved = second_sums(arrays["motion"])[rows][:, ::3, :2] * POSITION_M
    starts = arrays["start"][first % which.shape[1], :2] * POSITION_M
    found = []
    for line, start, model in zip(moved, starts, levels.reshape(-1)[first], strict=True):
        points = np.concatenate([start[None], start + line])
        d = "M" + " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
        found.append(element("path.way", d=d, stroke=info["colors"][model]))
    return found


def _vehicle(pose: NDArray[Any], size: tuple[float, float]) -> Html:
    (x, y), (length, width) = pose[:2] * POSITION_M, size
    turn = f"translate({x:.2f} {y:.2f}) rotate({np.degrees(pose[2] * HEADING_RAD):.1f})"
    box = {"x": f"{-length / 2:.2f}", "y": f"{-width / 2:.2f}", "width": f"{length:.2f}"}
    return element("rect.vehicle", height=f"{width:.2f}", transform=turn, **box)
