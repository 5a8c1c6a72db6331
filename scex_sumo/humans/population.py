"""Population of drivers: the fitted joint distribution from which `LikelyDriver` draws.

The numbers are in ``population.json``, written by ``benchmarks/calibrate_likely.py``.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from scipy.special import ndtri

from scex_sumo.base.arrays import FloatArray, IntArray
from scex_sumo.base.files import sha256_of

SHIPPED = Path(__file__).with_name("population.json")
NODES_S = (0.0, 1.5, 3.0)  # additional accelerations are drawn for these times, linear between them
FAR_M = 50.0  # a leader beyond this does not influence them
MAX_ADDITIONAL_MPS2 = 5.0
ASIDE_S = 3.0
MAX_ASIDE_M = 1.75  # from the path, for a vehicle that keeps its lane
MAX_CHANGE_M = 5.0
DEGREES = 4  # of freedom of the drawn accelerations: few, for rare large deviations
_WEYL = np.uint64(0x9E3779B97F4A7C15)


@dataclass(frozen=True, kw_only=True, eq=False)
class Population:
    """Distribution of drivers."""

    speed_edges: FloatArray  # (K - 1,) m/s between the K classes by speed in the seed scene
    # (K, 3, 9) weights of ``features`` for the expected additional acceleration in three seconds, m/s²
    mean: FloatArray
    # (K, 3, 3) lower triangular root of the scale matrix, m/s²
    root: FloatArray
    noise: FloatArray  # (3,) growth with the scatter, see `spread_of`
    unsure: FloatArray  # (2,) growth with the other columns of ``unsure``
    skew: FloatArray  # (K,) accelerating draws are exp(skew) times as large, braking ones exp(-skew)
    headway: tuple[float, float]  # mean and standard deviation of the logarithm, s
    braking: tuple[float, float]  # the same of the deceleration for a leader, m/s²
    habit_s: float  # time constant of the shown acceleration
    start: FloatArray  # (5,) weights of `start_features` for the log rate, 1/s
    stop: FloatArray  # (5,) weights of `stop_features` for the log odds
    keeps_side: FloatArray  # (3,) weights of ``across`` for the offset after `ASIDE_S`
    side_m: float  # scale of the deviation, m
    side_noise: FloatArray  # (1,) its growth with ``side_shown``, see `spread_of`
    side_unsure: FloatArray  # (2,)
    change: FloatArray  # (7,) weights of `change_features`
    change_to: (
        FloatArray  # (3,) weights of the lane's distance, offset and lateral speed for the offset in 3 s
    )
    change_m: float  # scale of the deviation, m
    path: FloatArray  # (4,) weights of `path_features`

    def speed_class(self, speed: FloatArray) -> IntArray:
        """(n,) class of each speed."""
        return np.searchsorted(self.speed_edges, speed, side="right").astype(np.int64)

    def additional_acceleration(
        self, speed: FloatArray, features: FloatArray, unsure: FloatArray, draw: FloatArray
    ) -> FloatArray:
        """Return (n, 3) additional accelerations in three seconds, m/s².

        Args:
            speed: (n,) in the seed scene, m/s.
            draw: (n, 3) Student's numbers; 0 is the expected driver.
        """
        k = self.speed_class(speed)
        drawn = np.einsum("nij,nj->ni", self.root[k], draw)
        skewed = self.skew[k] * np.sign(drawn.sum(axis=1))
        added: FloatArray = np.einsum("nij,nj->ni", self.mean[k], features) + drawn * np.exp(skewed)[
            :, None
        ] * spread_of(unsure, self.noise, self.unsure)
        return np.clip(added, -MAX_ADDITIONAL_MPS2, MAX_ADDITIONAL_MPS2)


@cache
def population() -> Population:
    """Load the shipped population."""
    given = json.loads(SHIPPED.read_text(encoding="utf-8"))
    arrays = (
        "speed_edges",
        "mean",
        "root",
        "noise",
        "unsure",
        "skew",
        "keeps_side",
        "side_noise",
        "side_unsure",
        "change",
        "change_to",
        "path",
        "start",
        "stop",
    )
    return Population(
        **{name: np.array(given[name]) for name in arrays},
        headway=(given["headway"][0], given["headway"][1]),
        braking=(given["braking"][0], given["braking"][1]),
        habit_s=given["habit_s"],
        side_m=given["side_m"],
        change_m=given["change_m"],
    )


def spread_of(shown: FloatArray, noise: FloatArray, unsure: FloatArray) -> FloatArray:
    """(n, N) factor on the deviation of drivers, from their variation and the noise of their boxes.

    Args:
        shown: (n, 3) scatter of the accelerations, m/s², and two features of the variation.
        noise: (N,) 1/(m/s²): at a scatter of 1 / noise half of the variance is noise.
        unsure: (2,) weights of the features in an exponential.
    """
    grown: FloatArray = np.hypot(1.0, shown[:, :1] * noise) * np.exp(shown[:, 1:] @ unsure)[:, None]
    return grown


def node_shares(time_s: float) -> FloatArray:
    """(3,) weights of linear interpolation between `NODES_S`; the last value goes on."""
    return np.array([np.interp(time_s, NODES_S, row) for row in np.eye(len(NODES_S))])


def population_digest() -> str:
    """Return the SHA-256 of the shipped population."""
    return sha256_of(SHIPPED)


def way_across(across: FloatArray, target: FloatArray, time_s: FloatArray) -> FloatArray:
    """(n, T) offsets from the path with the least jerk, from the shown motion to the target.

    Args:
        across: (n, 3) offset, m, speed, m/s, and acceleration, m/s², at time 0.
        target: (n,) offset after `ASIDE_S`, kept from then on, m.
        time_s: (T,).

    Source: Takahashi et al. 1989, the quintic polynomial.
    """
    u = np.minimum(time_s / ASIDE_S, 1.0)
    shape = (
        1 - 10 * u**3 + 15 * u**4 - 6 * u**5,
        ASIDE_S * (u - 6 * u**3 + 8 * u**4 - 3 * u**5),
        ASIDE_S**2 * (u**2 - 3 * u**3 + 3 * u**4 - u**5) / 2,
    )
    begun: FloatArray = across @ np.stack(shape)
    return np.asarray(begun + target[:, None] * (1 - shape[0]))


def uniforms(draw: FloatArray, count: int, salt: int = 0, *, first: int = 0) -> FloatArray:
    """(n, count) pseudo-random numbers in (0, 1) that follow from one number each.

    Args:
        draw: (n,) in [0, 1), one per vehicle of a child.
        first: of the numbers of a salt.

    Source: the mixing function of SplitMix64, Steele, Lea, Flood 2014.
    """
    with np.errstate(over="ignore"):
        step = np.arange(first + 1, first + count + 1, dtype=np.uint64) + np.uint64(64 * (salt + 1))
        z = np.ascontiguousarray(draw, dtype=np.float64).view(np.uint64)[:, None] + step * _WEYL
        z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        z = z ^ (z >> np.uint64(31))
    result: FloatArray = ((z >> np.uint64(11)).astype(np.float64) + 0.5) / 2.0**53
    return result


def students(uniform: FloatArray) -> FloatArray:
    """(n, 3) numbers of Student's multivariate distribution with four degrees of freedom.

    Args:
        uniform: (n, 5) three for a normal vector and two for the common χ² with four degrees, -2·ln(u·u').
    """
    chi2 = -2.0 * np.log(uniform[:, 3] * uniform[:, 4])
    result: FloatArray = ndtri(uniform[:, :3]) * np.sqrt(DEGREES / chi2)[:, None]
    return result
