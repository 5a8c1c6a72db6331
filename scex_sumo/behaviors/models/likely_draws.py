"""Random variables of a likely driver in words, for the causes of rare collisions: see docs/rare.md."""

from __future__ import annotations

from typing import Final

import numpy as np
from scipy.special import ndtri

from scex_sumo.base.arrays import FloatArray
from scex_sumo.behaviors.models.attention import EVERY_S, GLANCE_S, GLANCE_SPREAD, MANNER, looks_away
from scex_sumo.behaviors.models.likely_driver import DRIVER, PATH, START, STARTS, LikelyProfile
from scex_sumo.behaviors.models.population import uniforms

_SPEED, _NOTHING = ("slows down", "speeds up"), ("", "")
_UNIFORM = (
    (DRIVER, 0, _SPEED),  # additional acceleration at 0 s, at 1.5 s, at 3 s
    (DRIVER, 1, _SPEED),
    (DRIVER, 2, _SPEED),
    (DRIVER, 3, _NOTHING),  # high: extreme accelerations
    (DRIVER, 4, _NOTHING),
    (DRIVER, 5, ("follows closely", "")),
    (DRIVER, 6, ("drifts to the right", "drifts to the left")),
    (DRIVER, 7, ("brakes gently", "")),
    (DRIVER, 8, _NOTHING),  # high: extreme offsets
    (DRIVER, 9, _NOTHING),
    (DRIVER, 10, ("", "creeps")),
    (DRIVER, 11, ("changes to the left", "changes to the right")),
    (DRIVER, 12, ("stops", "")),
    (PATH, 0, _NOTHING),
    (STARTS, 0, ("starts", "keeps standing")),
    (START, 0, ("starts late", "starts early")),
    (MANNER, 0, ("", "reacts slowly")),
    (MANNER, 1, ("", "brakes late")),
)
"""Salt, column, and what low and high numbers mean."""

AWAY_S = (-0.4, 0.2, 0.8, 1.4)
"""Times at which a driver may look away, s; it acts on them one reaction time later."""

_GRID = 4000


WORDS: Final = (*(words for _, _, words in _UNIFORM), *[("", "inattentive")] * len(AWAY_S))
"""What low and high scores mean, for each variable."""

INATTENTIVE: Final = slice(len(_UNIFORM), None)
"""Variables whose high scores mean a driver that looks away at one of `AWAY_S`."""


def likely_scores(draw: FloatArray, profile: LikelyProfile) -> FloatArray:
    """Return the random variables (n, K) of likely drivers with numbers (n,), with mean 0 and variance 1.

    A variable is 0 if it is constant.
    """
    drawn = [ndtri(uniforms(draw, 1, salt, first=column)) for salt, column, _ in _UNIFORM]
    away = looks_away(draw, np.tile(AWAY_S, (len(draw), 1)), profile.inattention)
    share = np.array([share_away(time, profile.inattention) for time in AWAY_S])
    spread = np.sqrt(share * (1 - share))
    return np.concatenate(
        [*drawn, np.where(spread > 0, away - share, 0.0) / np.maximum(spread, 1e-9)], axis=1
    )


def share_away(time_s: float, factor: float) -> float:
    """Return the probability that a driver looks away at a time, by quadrature over the glance's duration."""
    lasts = GLANCE_S * max(factor, 1.0) * np.exp(GLANCE_SPREAD * ndtri((np.arange(_GRID) + 0.5) / _GRID))
    first = int(np.floor(time_s / EVERY_S))
    sees = 1.0
    for number in (first - 1, first):
        begin, end = EVERY_S * number, EVERY_S * (number + 1)
        inside = np.clip(min(time_s, end) - np.maximum(time_s - lasts, begin), 0.0, None)
        sees *= 1 - min(factor, 1.0) * float(inside.mean()) / EVERY_S
    return 1 - sees
