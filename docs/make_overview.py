"""Draw docs/images/overview.png: a seed scene with its futures beside two of its densities.

Run: ``python docs/make_overview.py`` (about 10 s).
"""

from __future__ import annotations

from pathlib import Path

import matplotlib.image as mpimg
import matplotlib.pyplot as plt

import scex_sumo as scex
from scex_sumo.plots import cumulative_panel, density_panel, draw_scene, futures_of

IMAGES = Path(__file__).resolve().parent / "images"


def main() -> None:
    """Run the roundabout example and put its pictures together."""
    seed = scex.read_seed(scex.example_path("roundabout"))
    run = scex.extrapolate(seed, models="standard_driver:path=random,risky_driver:path=random,constant_velocity")
    assert seed.road is not None
    IMAGES.mkdir(exist_ok=True)
    scene = draw_scene(seed.road, seed, futures_of(run, seed), run.folder / "scene.png")
    figure, axes = plt.subplot_mosaic([["scene", "a"], ["scene", "b"]], figsize=(10, 6), layout="constrained")
    axes["scene"].imshow(mpimg.imread(scene))
    axes["scene"].set_axis_off()
    axes["scene"].set_title(f"one moment, {run.children} futures", loc="left", fontsize=10)
    density_panel(run, "distance_mean", axes["a"])
    cumulative_panel(run, "ttc", axes["b"])
    axes["a"].set_title("mean of the closest distances [m]: density", loc="left", fontsize=10)
    axes["b"].set_title("worst 1/TTC [1/s]: cumulative, with 95 % band", loc="left", fontsize=10)
    figure.savefig(IMAGES / "overview.png", dpi=110)


if __name__ == "__main__":
    main()
