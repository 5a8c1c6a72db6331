"""One colour per behaviour model, the same in sumo-gui, plots and legends."""

from __future__ import annotations

from collections.abc import Sequence

Rgb = tuple[int, int, int]

_KNOWN: dict[str, Rgb] = {
    "standard_driver": (54, 124, 196),
    "risky_driver": (214, 64, 58),
    "constant_velocity": (240, 180, 40),
    "emergency_brake": (138, 43, 180),
    "calibrated_driver": (46, 160, 90),
    "replay": (245, 245, 245),
    "graph_predictor": (20, 190, 200),
    "graph_image_predictor": (232, 110, 180),
}
_OTHERS: tuple[Rgb, ...] = ((150, 110, 70), (120, 200, 60), (90, 90, 220), (250, 130, 50), (130, 130, 130))


def model_colors(names: Sequence[str]) -> tuple[Rgb, ...]:
    """A colour for each model of a run, 0 to 255; models of one name with other parameters share it.

    Args:
        names: the models as the user wrote them, ``name[:parameter=value]...``.
    """
    others: dict[str, Rgb] = {}
    colors = []
    for name in names:
        base = name.split(":", 1)[0] if not name.startswith("sumo:") else name
        if base in _KNOWN:
            colors.append(_KNOWN[base])
        else:
            colors.append(others.setdefault(base, _OTHERS[len(others) % len(_OTHERS)]))
    return tuple(colors)
