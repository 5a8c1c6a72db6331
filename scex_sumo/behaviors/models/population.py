"""Population of drivers: the fitted joint distribution that `LikelyDriver` draws each vehicle's driver from.

The numbers are in ``behaviors/weights/likely_driver.json``, written by ``benchmarks/calibrate_likely.py``.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from scex_sumo.arrays import FloatArray, IntArray
from scex_sumo.statistics.normal import normal_quantiles

SHIPPED = Path(__file__).parents[1] / "weights" / "likely_driver.json"
NODES_S = (0.0, 1.5, 3.0)  # a driver's own acceleration is drawn for these times, and linear between them
FAR_M = 50.0  # a leader beyond this does not count for that
MOST_OWN_MPS2 = 5.0
ASIDE_S = 3.0
MOST_ASIDE_M = 1.75  # from the path: further off, a vehicle is on its way somewhere
MOST_CHANGE_M = 5.0
DEGREES = 4  # of freedom of the drawn accelerations: people are at times far from what one expects
_WEYL = np.uint64(0x9E3779B97F4A7C15)


@dataclass(frozen=True, kw_only=True, eq=False)
class Population:
    """Distribution of drivers.

    Attributes:
        speed_edges: (K - 1,) m/s between the K classes by speed in the seed scene.
        mean: (K, 3, 7) the expected own acceleration in each of three seconds, m/s², linear in what the seed
            scene shows, ``Seen.features``.
        root: (K, 3, 3) lower triangular; root @ root.T is the scale matrix of what is left, (m/s²)²,
        noise: (3,) and its square root grows with the scatter shown and by
        unsure: (2,) with the rest of ``Seen.unsure``, see `spread_of`.
        skew: (K,) draws that accelerate are exp(skew) times as large, those that brake exp(-skew) times.
        headway: mean and standard deviation of the logarithm of the time headway in s.
        braking: likewise of the deceleration with which it comes up to its leader, in m/s².
        habit_s: for how long what it does beside what is asked of it lasts, s.
        start_rate: 1/s at which a standing vehicle starts: behind a standing leader, a moving one, alone.
        keeps_side: (3,) what of `Seen.across` makes the offset from its path that a vehicle moves to within
            `ASIDE_S`: 1, s, s²,
        side_m: and the scale of the rest, of `DEGREES`, m, which grows by
        side_noise: (1,) and
        side_unsure: (2,) with what ``side_shown`` gives, see `spread_of`.
        change: (7,) weights of what makes a driver be on its way to the next lane, see `change_features`,
        change_to: (3,) of that lane's distance, the offset and the speed across: where it will be in 3 s,
        change_m: and the scale of the rest, of `DEGREES`, m.
        path: (4,) weights of how a path fits the seed scene, see `path_features`.
    """

    speed_edges: FloatArray
    mean: FloatArray
    root: FloatArray
    noise: FloatArray
    unsure: FloatArray
    skew: FloatArray
    headway: tuple[float, float]
    braking: tuple[float, float]
    habit_s: float
    start_rate: tuple[float, float, float]
    keeps_side: FloatArray
    side_m: float
    side_noise: FloatArray
    side_unsure: FloatArray
    change: FloatArray
    change_to: FloatArray
    change_m: float
    path: FloatArray

    def speed_class(self, speed: FloatArray) -> IntArray:
        """(n,) class of each speed."""
        return np.searchsorted(self.speed_edges, speed, side="right").astype(np.int64)

    def own_acceleration(
        self, speed: FloatArray, features: FloatArray, unsure: FloatArray, draw: FloatArray
    ) -> FloatArray:
        """What each driver adds to the acceleration that the situation asks for.

        Args:
            speed: (n,) in the seed scene, m/s.
            features: (n, 7) as in ``Seen``.
            unsure: (n, 3) likewise.
            draw: (n, 3) of Student's distribution with `DEGREES`; 0 is the expected driver.

        Returns:
            (n, 3) m/s² in each of three seconds.
        """
        k = self.speed_class(speed)
        drawn = np.einsum("nij,nj->ni", self.root[k], draw)
        skewed = self.skew[k] * np.sign(drawn.sum(axis=1))
        own: FloatArray = np.einsum("nij,nj->ni", self.mean[k], features) + drawn * np.exp(skewed)[
            :, None
        ] * spread_of(unsure, self.noise, self.unsure)
        return np.clip(own, -MOST_OWN_MPS2, MOST_OWN_MPS2)


@cache
def population() -> Population:
    """The shipped population."""
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
    )
    standing, moving, alone = given["start_rate"]
    return Population(
        **{name: np.array(given[name]) for name in arrays},
        headway=(given["headway"][0], given["headway"][1]),
        braking=(given["braking"][0], given["braking"][1]),
        start_rate=(standing, moving, alone),
        habit_s=given["habit_s"],
        side_m=given["side_m"],
        change_m=given["change_m"],
    )


def spread_of(shown: FloatArray, noise: FloatArray, unsure: FloatArray) -> FloatArray:
    """(n, N) factor on what drivers differ by: of people and of the noise of their boxes, as squares.

    Args:
        shown: (n, 3) scatter of the accelerations, m/s², then what people differ by.
        noise: (N,) 1/(m/s²): at a scatter of 1 / noise half of the variance is noise.
        unsure: (2,) of the rest: the factor grows with its exponential.
    """
    grown: FloatArray = np.hypot(1.0, shown[:, :1] * noise) * np.exp(shown[:, 1:] @ unsure)[:, None]
    return grown


def node_shares(time_s: float) -> FloatArray:
    """(3,) share of each of `NODES_S` in what is linear between them; the last one goes on."""
    return np.array([np.interp(time_s, NODES_S, row) for row in np.eye(len(NODES_S))])


def population_digest() -> str:
    """SHA-256 of the shipped population."""
    return hashlib.sha256(SHIPPED.read_bytes()).hexdigest()


def way_across(across: FloatArray, target: FloatArray, time_s: FloatArray) -> FloatArray:
    """(n, T) offsets from the path with the least jerk, from what is shown to where a vehicle wants to be.

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


def uniforms(draw: FloatArray, count: int, salt: int = 0) -> FloatArray:
    """(n, count) numbers in (0, 1) that follow from one number each, the same in every plan.

    Args:
        draw: (n,) in [0, 1), one for each vehicle of a child.
        count: how many.
        salt: another one gives others.

    Source: the mixing function of SplitMix64, Steele, Lea, Flood 2014.
    """
    with np.errstate(over="ignore"):
        step = np.arange(1, count + 1, dtype=np.uint64) + np.uint64(64 * (salt + 1))
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
    result: FloatArray = normal_quantiles(uniform[:, :3]) * np.sqrt(DEGREES / chi2)[:, None]
    return result
