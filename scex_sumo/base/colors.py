"""One colour per behaviour model in sumo-gui, plots and pages, for the colour-blind; after Okabe and Ito."""

from __future__ import annotations

from collections.abc import Sequence

Rgb = tuple[int, int, int]

OTHER_RGB: Rgb = (255, 0, 200)  # pedestrians and cyclists

_KNOWN: dict[str, Rgb] = {
    "standard_driver": (63, 143, 210),
    "risky_driver": (213, 94, 0),
    "constant_velocity": (230, 168, 23),
    "emergency_brake": (166, 95, 160),
    "calibrated_driver": (10, 163, 122),
    "replay": (138, 145, 153),
    "graph_predictor": (53, 185, 201),
    "graph_image_predictor": (199, 124, 158),
}
_OTHERS: tuple[Rgb, ...] = ((91, 98, 194), (140, 109, 70), (127, 174, 46), (208, 86, 122), (111, 125, 140))


def model_colors(names: Sequence[str]) -> tuple[Rgb, ...]:
    """Return a colour for each model of a run, 0 to 255.

    Args:
        names: as the user wrote them, ``name[:parameter=value]...``; the first of a name gets its own colour.
    """
    colors: dict[str, Rgb] = {}
    others = 0
    for name in names:
        known = _KNOWN.get(name.split(":", 1)[0])
        if name in colors:
            continue
        if known is None or known in colors.values():
            known, others = _OTHERS[others % len(_OTHERS)], others + 1
        colors[name] = known
    return tuple(colors[name] for name in names)
