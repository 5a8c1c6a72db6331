"""Road of a page: surfaces and markings around the vehicles, as small integers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scex_sumo.reports.page.packing import quantized
from scex_sumo.views.road_lines import road_lines

UNIT_M = 0.05


def road_arrays(net: Path, box: tuple[float, float, float, float]) -> dict[str, NDArray[Any]]:
    """Lines of the road within a box.

    Args:
        net: NET.net.xml, with NET.add.xml beside it.
        box: least and largest x, least and largest y, m.

    Returns:
        ``road_points`` (P, 2) first differences within each line, ``road_sizes`` (L,) their numbers of
        points, ``road_kinds`` (L,) and ``road_widths`` (L,) in units of 5 cm.
    """
    kept = road_lines(net, box)
    whole = [quantized(points, UNIT_M) for _, _, points in kept]
    steps = [np.diff(points, axis=0, prepend=0) for points in whole]
    return {
        "road_points": np.concatenate(steps) if steps else np.zeros((0, 2), dtype=np.int64),
        "road_sizes": np.array([len(points) for points in whole], dtype=np.int64),
        "road_kinds": np.array([kind for kind, _, _ in kept], dtype=np.int64),
        "road_widths": quantized(np.array([width for _, width, _ in kept], dtype=float), UNIT_M),
    }
