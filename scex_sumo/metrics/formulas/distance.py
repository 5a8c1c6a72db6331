"""Distance between the centres of two vehicles."""

from __future__ import annotations

from scex_sumo.metrics.pairs.scenes import Samples, Scenes


def distance(scenes: Scenes) -> Samples:
    """Distance of the centres of all pairs, m; undefined for fewer than two vehicles.

    Returns:
        (P, C, T) of unordered pairs. Smaller is more critical.
    """
    return scenes.unordered(scenes.distance)
