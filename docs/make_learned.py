"""Draw docs/images/attention.png: an example, and what is planned for several attention weights.

Run: ``python docs/make_learned.py`` (about 10 s; needs the extra ``learned``).
"""

from __future__ import annotations

from pathlib import Path

import scex_sumo as scex

IMAGES = Path(__file__).resolve().parent / "images"


def main() -> None:
    """Read the example and draw it."""
    IMAGES.mkdir(exist_ok=True)
    scene = scex.read_seed(scex.example_path("roundabout"))
    scex.plot_attention(scene, IMAGES / "attention.png", around_m=32.0)


if __name__ == "__main__":
    main()
