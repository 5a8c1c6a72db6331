"""Picture of a seed scene on a ranking's page: the road, the vehicles, and where its children went."""

from __future__ import annotations

import io

import numpy as np

from scex_sumo.arrays import FloatArray
from scex_sumo.reports.pictures.runs import look_at, scene_panel, ways
from scex_sumo.reports.pictures.sheet import sheet
from scex_sumo.scene import SeedScene

_WIDTH_IN = 5.6
_DPI = 110


def scene_png(scene: SeedScene, x: FloatArray, y: FloatArray) -> bytes:
    """The bytes of a PNG; the same scene has the same.

    Args:
        scene: the seed scene, with its road.
        x: (C, V, T) centres of the vehicles in the children, m.
        y: likewise.
    """
    assert scene.road is not None
    with sheet(_WIDTH_IN, _WIDTH_IN) as figure:
        axes = figure.subplots()
        scene_panel(axes, scene.road, scene, ways(x, y))
        # A square keeps a street that runs across it large, where the scene alone would be a thin strip.
        low, high = np.array([axes.get_xlim(), axes.get_ylim()]).T
        size = max(high - low) * np.clip((high - low) / max(high - low), 0.45, 1.0)
        look_at(axes, (low + high - size) / 2, (low + high + size) / 2)
        figure.set_size_inches(_WIDTH_IN * size / max(size) + 0.5)
        sink = io.BytesIO()
        figure.savefig(sink, format="png", dpi=_DPI, metadata={"Software": None})
    return sink.getvalue()
