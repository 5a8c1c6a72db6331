"""Draw docs/images/scene_graph.png: the example roundabout with its semantic scene graph.

Run: ``python docs/make_scene_graph.py`` (about 2 s).
"""

from __future__ import annotations

from pathlib import Path

import scex_sumo as scex

IMAGES = Path(__file__).resolve().parent / "images"


def main() -> None:
    """Read the example and draw it."""
    scene = scex.read_seed(scex.example_path("roundabout"))
    IMAGES.mkdir(exist_ok=True)
    title = "One moment on the example roundabout, and its scene graph"
    scex.plot_scene_graph(scene, IMAGES / "scene_graph.png", title=title)


if __name__ == "__main__":
    main()
