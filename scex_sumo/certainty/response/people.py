"""People: how often they do what, how late they respond, and how hard they brake.

The numbers are in ``response.json``, each with its unit and source. A file of one's own may give some.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache, cached_property
from pathlib import Path
from typing import Any, Final

import numpy as np
from scipy.special import ndtr, ndtri

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.base.errors import UsageError, nearest
from scex_sumo.certainty.response.critical import DECELERATIONS, by_action
from scex_sumo.certainty.response.motion.actions import ACTIONS, BRAKES, LEVELS, STEPS_OUT, TIME_S, Cases
from scex_sumo.geometry.rectangles import Rectangles, separation
from scex_sumo.scene import STEP_S

SHIPPED: Final = Path(__file__).with_name("response.json")
REFERENCE_GAP_S: Final = 2.0
"""Time gap from which one responds, and looks away, as drivers do without a leader."""
CLOSEST: Final = 0.1
"""Share of `REFERENCE_GAP_S`, least that counts."""
DRAWS: Final = 32
"""Draws of the response time of a driver that looks away."""

_NUMBERS = (
    *("response_factor", "response_spread", "away_share", "glance_s", "glance_spread"),
    *("close_response", "close_away", "growth"),
)
_MIN_GAP_M = 0.1
_EVERY = slice(None, None, 4)


@dataclass(frozen=True, kw_only=True, eq=False)
class People:
    """Distributions of actions and responses.

    Attributes:
        response_s: (5,) median response time to each action, s.
        response_factor: of the medians either way, 95 %.
        response_spread: standard deviation of the logarithm of response times.
        decelerations: (3,) shares of `DECELERATIONS`.
        away_share: share of the time of glances away.
        glance_s: their median duration, s; ``glance_spread``: standard deviation of the logarithm.
        close_response: exponent of the time gap, as a share of 2 s, on the median.
        close_away: the same on ``away_share``.
        growth: exponent of the gap that is left at the response, as a share of that at the onset.
        braking: (K, 10) how often a vehicle begins to brake within 3 s, with at least each value.
        speed_edges: (K / 2 - 1,) between its classes of speed, m/s; those that follow a leader come first.
        shapes: (4, 10) share of the other actions with at least each value.
        rates: (5, R) how often they happen, by the time that they leave to the responder; the last row is
            that of people that approach and step out.
        rate_edges_s: (R - 1,) between the classes of R*, s.
        factors: (5, 10) uncertainty of the frequencies, a factor either way, 95 %.
    """

    response_s: FloatArray
    response_factor: float
    response_spread: float
    decelerations: FloatArray
    away_share: float
    glance_s: float
    glance_spread: float
    close_response: float
    close_away: float
    growth: float
    braking: FloatArray
    speed_edges: FloatArray
    shapes: FloatArray
    rates: FloatArray
    rate_edges_s: FloatArray
    factors: FloatArray

    @cached_property
    def _glances(self) -> FloatArray:
        """(T,) share of glances away that last on for `TIME_S` from a random moment in them."""
        time, spread = np.maximum(TIME_S, 1e-9), self.glance_spread
        z = (np.log(time / self.glance_s)) / spread
        mean = self.glance_s * np.exp(spread**2 / 2)
        # E[max(G - t, 0)] / E[G] of a lognormal G
        return np.asarray(ndtr(spread - z) - time / mean * ndtr(-z))

    def later(
        self, response_s: FloatArray, action: IntArray, gap_s: FloatArray, left: FloatArray
    ) -> FloatArray:
        """Return the probability that one responds later than a time.

        Args:
            response_s: (...) s; -inf gives 1, inf gives 0.
            action: (...) index into `ACTIONS`.
            gap_s: (...) time gap to the initiator, s.
            left: (...) gap at the response as a share of the largest since the onset.
        """
        near = np.clip(gap_s / REFERENCE_GAP_S, CLOSEST, 1.0)
        median = np.broadcast_to(self.response_s[action] * near**self.close_response, response_s.shape)
        time = np.clip(response_s, 1e-6, TIME_S[-1])
        attentive = 1 - ndtr(np.log(time / median) / self.response_spread)
        draws = ndtri((np.arange(DRAWS) + 0.5) / DRAWS)
        begins = time[..., None] - median[..., None] * np.exp(self.response_spread * draws)
        still = np.where(begins > 0, np.interp(begins, TIME_S, self._glances), 1.0).mean(axis=-1)
        away = self.away_share * near**self.close_away
        share = ((1 - away) * attentive + away * still) * np.clip(left, 0.0, 1.0) ** self.growth
        return np.where(response_s == np.inf, 0.0, np.where(response_s == -np.inf, 1.0, share))

    def often(
        self,
        *,
        action: IntArray,
        speed: FloatArray,
        follows: BoolArray,
        response_s: FloatArray,
    ) -> FloatArray:
        """Return (n, 10) how often an initiator does it with at least each value of the parameter.

        An initiator sees how much time it leaves to the responder.

        Args:
            action: (n,) index into `ACTIONS`; ``speed`` (n,) of the initiator, m/s.
            follows: (n,) whether it follows a leader; of people, whether they approach.
            response_s: (n, 10) R* at the typical deceleration, s.
        """
        row = np.searchsorted(self.speed_edges, speed) + np.where(follows, 0, len(self.speed_edges) + 1)
        kind = np.maximum(action - 1, 0)
        share = -np.diff(self.shapes, axis=1, append=0.0)[kind]
        near = kind + ((action == STEPS_OUT) & follows)
        rate = self.rates[near[:, None], np.searchsorted(self.rate_edges_s, response_s)]
        others = np.cumsum((share * rate)[:, ::-1], axis=1)[:, ::-1]
        return np.where((action == BRAKES)[:, None], self.braking[row], others)

    def slower(self, factor: float) -> People:
        """Return people with so many times the median response times."""
        return replace(self, response_s=self.response_s * factor)


def probabilities(often: FloatArray, later: FloatArray, action: IntArray) -> FloatArray:
    """Return (n,) probabilities ∫ f(θ) P(r > R*(θ)) dθ: the integral over the parameter of an action.

    Between two values of braking, ``later`` is linear and ``often`` exponential. Other actions have the lower
    value, because their frequency jumps with the time that they leave.

    Args:
        often: (n, 10) frequency of at least each value.
        later: (n, 10) probability of a response later than R*.
        action: (n,) index into `ACTIONS`.
    """
    after = np.concatenate([often[:, 1:], np.zeros_like(often[:, :1])], axis=1)
    following = np.concatenate([later[:, 1:], later[:, -1:]], axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        mean = (often - after) / np.log(often / after)
    mean = np.where(np.isfinite(mean), mean, np.where(often == after, often, 0.0))
    smooth = often * later - after * following + (following - later) * mean
    steps = (often - after) * later
    return np.asarray(np.where((action == BRAKES)[:, None], smooth, steps).sum(axis=1))


def people_of(file: Path | None = None) -> People:
    """Return the shipped distributions, with those of a file in the place of some.

    Raises:
        UsageError: the file cannot be read, or a name in it is unknown.
    """
    return _shipped() if file is None else _read({**_content(SHIPPED), **_own(file)}, file)


@cache
def _shipped() -> People:
    return _read(_content(SHIPPED), SHIPPED)


def _content(file: Path) -> dict[str, Any]:
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise UsageError(f"{file}: cannot be read ({str(error)[:80]}); give a JSON file") from None
    if not isinstance(content, dict):
        raise UsageError(f"{file}: holds no object; give names with values")
    return content


def _own(file: Path) -> dict[str, Any]:
    given, known = _content(file), _content(SHIPPED)
    for name in given:
        if name not in known:
            raise UsageError(f"{file}: unknown name {name!r}; nearest: {nearest(name, known)}")
    if "actions" in given:
        given["actions"] = {**known["actions"], **given["actions"]}
    return given


def _read(content: Mapping[str, Any], file: Path) -> People:
    def value(name: str) -> Any:
        entry = content[name]
        return entry["value"] if isinstance(entry, Mapping) and "value" in entry else entry

    try:
        braking, *others = (content["actions"][action.name] for action in ACTIONS)
        medians = value("response_s")
        people = People(
            response_s=np.array([medians[action.name] for action in ACTIONS], dtype=np.float64),
            decelerations=np.array(value("decelerations"), dtype=np.float64),
            braking=np.array([*braking["following"], *braking["free"]], dtype=np.float64),
            speed_edges=np.array(braking["speed_edges_mps"], dtype=np.float64),
            shapes=np.array([one["shape"] for one in others], dtype=np.float64),
            rates=np.array([*(one["rates"] for one in others), others[-1]["approaching"]], dtype=np.float64),
            rate_edges_s=np.array(value("rate_edges_s"), dtype=np.float64),
            factors=np.stack([np.broadcast_to(one["factor"], LEVELS) for one in (braking, *others)]),
            **{name: float(value(name)) for name in _NUMBERS},
        )
    except (KeyError, TypeError, ValueError) as error:
        raise UsageError(f"{file}: {error!s:.80}: compare with {SHIPPED.name} of the package") from None
    tables = (people.braking, people.shapes)
    right = all(table.shape[-1] == LEVELS and (np.diff(table) <= 0).all() for table in tables)
    right &= len(people.braking) == 2 * (len(people.speed_edges) + 1)
    right &= people.rates.shape == (len(ACTIONS), len(people.rate_edges_s) + 1)
    if not right or people.decelerations.shape != (len(DECELERATIONS),):
        raise UsageError(f"{file}: frequencies need {LEVELS} values that do not grow, and a row a class")
    return people


def left_at(cases: Cases, response_s: FloatArray) -> FloatArray:
    """Return (m, A) share of the largest body gap since the onset that is left at responses (m, A)."""
    left = np.ones_like(response_s)
    rows = np.flatnonzero((np.isfinite(response_s) & np.isfinite(cases.onset_s)[:, None]).any(axis=1))
    cases, response_s = cases.take(rows), response_s[rows]
    onset, each = cases.onset_s[:, None], np.arange(len(rows))
    until = onset[:, None] + np.clip(response_s, 0.0, TIME_S[-1])[..., None]  # (m, A, 1)
    gap = np.maximum(_body_gaps(cases), _MIN_GAP_M)[:, None]  # (m, 1, K)
    since = (TIME_S[_EVERY] >= onset - STEP_S)[:, None] & (TIME_S[_EVERY] <= until)
    first = np.argmin(np.abs(TIME_S[_EVERY] - onset), axis=1)
    most = np.maximum(np.where(since, gap, 0.0).max(axis=2), gap[each, 0, first][:, None])
    position = np.minimum(until[..., 0] / TIME_S[_EVERY][1], gap.shape[2] - 1.001)
    index = position.astype(np.int64)
    share, row = position - index, each[:, None]
    at = gap[row, 0, index] ** (1 - share) * gap[row, 0, index + 1] ** share
    left[rows] = np.minimum(at / most, 1.0)
    return left


def _body_gaps(cases: Cases) -> FloatArray:
    """Return (m, K) distance of the outlines at `_EVERY` few steps, with the responder as expected, m."""
    expected, others = cases.pairs.expected, cases.outlines
    j = cases.pairs.responder[cases.pair]
    x, y, heading = expected.lines.at(j, expected.s[j, _EVERY])
    own = Rectangles(
        x=x,
        y=y,
        heading=heading,
        half_length=expected.scene.length[j][:, None] / 2,
        half_width=expected.scene.width[j][:, None] / 2,
    )
    moved = {name: getattr(others, name)[:, _EVERY] for name in ("x", "y", "heading")}
    return separation(own, replace(others, **moved))


def time_gaps(cases: Cases) -> FloatArray:
    """Return (m,) time gap of responders to their initiators, s; inf where it is not ahead now."""
    pairs = cases.pairs
    speed = np.maximum(pairs.expected.scene.now.speed[pairs.responder], 0.5)
    enter = pairs.blocked.enter[:, 0]
    gap = np.where(enter >= 0, enter / speed, np.inf)
    return np.asarray(gap[cases.pair])


def later_than(people: People, cases: Cases, response_s: FloatArray) -> FloatArray:
    """Return (n, 10) probability that the responder comes too late, by pair's action and value.

    Args:
        response_s: (m, A) R* for each of `DECELERATIONS`.
    """
    gap, left = time_gaps(cases)[:, None], left_at(cases, response_s)
    late = people.later(response_s, cases.action[:, None], gap, left)
    return by_action(late @ people.decelerations)
