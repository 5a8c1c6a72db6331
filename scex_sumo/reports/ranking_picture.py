"""Picture of a seed scene on a ranking's page: the road, the vehicles, and where its children went."""

from __future__ import annotations

import io
from collections.abc import Sequence

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from scex_sumo.arrays import FloatArray
from scex_sumo.reports.run_pictures import scene_panel
from scex_sumo.scene import SeedScene

_WIDTH_IN = 5.6
_DPI = 110


def scene_png(scene: SeedScene, futures: Sequence[FloatArray]) -> bytes:
    """The bytes of a PNG; the same scene has the same.

    Args:
        scene: the seed scene, with its road.
        futures: V arrays (C, T, 2) of the vehicles' centres in the children, m.
    """
    assert scene.road is not None
    with plt.rc_context({"font.size": 8, "axes.spines.top": False, "axes.spines.right": False}):
        figure, axes = plt.subplots(figsize=(_WIDTH_IN, _WIDTH_IN), layout="constrained")
        scene_panel(axes, scene.road, scene, futures)
        # A square keeps a street that runs across it large, where the scene alone would be a thin strip.
        x, y = axes.get_xlim(), axes.get_ylim()
        half = max(x[1] - x[0], y[1] - y[0]) / 2
        middle = (x[0] + x[1]) / 2, (y[0] + y[1]) / 2
        squash = (
            min(max((y[1] - y[0]) / (2 * half), 0.45), 1.0),
            min(max((x[1] - x[0]) / (2 * half), 0.45), 1.0),
        )
        axes.set_xlim(middle[0] - half * squash[1], middle[0] + half * squash[1])
        axes.set_ylim(middle[1] - half * squash[0], middle[1] + half * squash[0])
        figure.set_size_inches(_WIDTH_IN * squash[1] + 0.5, _WIDTH_IN * squash[0] + 0.5)
        axes.set(xlabel="x [m]", ylabel="y [m]")
        sink = io.BytesIO()
        figure.savefig(sink, format="png", dpi=_DPI, metadata={"Software": None})
        plt.close(figure)
    return sink.getvalue()


def futures_of(x: FloatArray, y: FloatArray) -> list[FloatArray]:
    """(C, V, T) centres as V arrays (C, T, 2)."""
    points = np.stack([x, y], axis=-1)
    return [points[:, vehicle] for vehicle in range(x.shape[1])]
