"""Draw docs/images/overview.png: a seed scene with its futures beside two of its densities.

Run: ``python docs/make_overview.py`` (about 10 s).
"""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt

import scex_sumo as scex
from scex_sumo.reports.run_pictures import cumulative_panel, density_panel, futures_of, scene_panel

MODELS = ("standard_driver", "risky_driver", "constant_velocity", "emergency_brake")
IMAGES = Path(__file__).resolve().parent / "images"


def main() -> None:
    """Run the example roundabout and put its pictures together."""
    scene = scex.read_seed(scex.example_path("roundabout"))
    run = scex.extrapolate(scene, models=[f"{m}:path=random" for m in MODELS])
    assert scene.road is not None
    IMAGES.mkdir(exist_ok=True)
    figure, axes = plt.subplot_mosaic(
        [["scene", "a"], ["scene", "b"]], figsize=(11, 6), layout="constrained", width_ratios=[1.25, 1]
    )
    scene_panel(axes["scene"], scene.road, scene, futures_of(run, scene))
    axes["scene"].set(xlim=(940, 1080), ylim=(925, 1060), xlabel="x [m]", ylabel="y [m]")
    density_panel(run, "distance_mean", axes["a"])
    cumulative_panel(run, "ttc", axes["b"])
    titles = {
        "scene": f"one moment, {run.children} futures of 3 s",
        "a": "mean of the closest distances [m]: density; dashed: recorded",
        "b": "worst 1/TTC [1/s]: cumulative, with its 95 % band",
    }
    for name, title in titles.items():
        axes[name].set_title(title, loc="left", fontsize=10)
    figure.savefig(IMAGES / "overview.png", dpi=100)


if __name__ == "__main__":
    main()
