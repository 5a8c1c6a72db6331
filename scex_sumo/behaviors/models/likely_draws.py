"""Random variables of a likely driver as classes, for importance sampling: see docs/rare.md."""

from __future__ import annotations

import numpy as np
from scipy.special import ndtri

from scex_sumo.base.arrays import FloatArray, IntArray
from scex_sumo.behaviors.models.attention import EVERY_S, GLANCE_S, GLANCE_SPREAD, MANNER, looks_away
from scex_sumo.behaviors.models.likely_driver import DRIVER, PATH, START, STARTS, LikelyProfile
from scex_sumo.behaviors.models.population import uniforms
from scex_sumo.statistics.tilting import UNIFORM_EDGES, Variables, normal_classes

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


def likely_variables(profile: LikelyProfile) -> Variables:
    """Return the random variables of likely drivers, with whether they look away at one of `AWAY_S`."""
    prior, score = normal_classes()
    away = np.array([share_away(time, profile.inattention) for time in AWAY_S])
    share = np.zeros((len(away), len(prior)))
    share[:, 0], share[:, 1] = 1 - away, away
    away_score = np.zeros_like(share)
    some = away > 0
    away_score[some, 0] = -np.sqrt(away[some] / (1 - away[some]))
    away_score[some, 1] = np.sqrt((1 - away[some]) / away[some])

    def classes(draw: FloatArray, variable: int) -> IntArray:
        if variable < len(_UNIFORM):
            salt, column, _ = _UNIFORM[variable]
            number = uniforms(draw, 1, salt, first=column)[:, 0]
            return np.searchsorted(UNIFORM_EDGES, number, side="right").astype(np.int64)
        time = np.full((len(draw), 1), AWAY_S[variable - len(_UNIFORM)])
        return looks_away(draw, time, profile.inattention)[:, 0].astype(np.int64)

    count = len(_UNIFORM)
    return Variables(
        words=(*(words for _, _, words in _UNIFORM), *[("", "inattentive")] * len(AWAY_S)),
        prior=np.concatenate([np.broadcast_to(prior, (count, len(prior))), share]),
        score=np.concatenate([np.broadcast_to(score, (count, len(score))), away_score]),
        classes=classes,
        inattentive=tuple(range(count, count + len(AWAY_S))),
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
