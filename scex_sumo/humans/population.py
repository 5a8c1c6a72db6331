"""Population of drivers: the random numbers of each driver, and the distributions which they draw from."""

from __future__ import annotations

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.base.draws import normal_quantiles
from scex_sumo.humans.parameters import HumanParameters

DEGREES = 4  # of freedom of Student's distribution: few, for rare large deviations


def drawn_variation(
    speed: FloatArray,
    mean_features: FloatArray,
    spread_features: FloatArray,
    draw: FloatArray,
    human: HumanParameters,
) -> FloatArray:
    """Return (n, 2) accelerations beyond the demanded ones at ``variation_times_s``, m/s².

    Args:
        speed: (n,) in the seed scene, m/s.
        mean_features: (n, F).
        spread_features: (n, 3).
        draw: (n, 2) Student's numbers; 0 is the expected driver.
    """
    k = (speed >= human.fast_mps).astype(np.int64)
    drawn = np.einsum("nij,nj->ni", human.variation_root[k], draw)
    skew = np.exp(human.variation_skew[k] * np.sign(drawn.sum(axis=1)))[:, None]
    spread = skew * spread_factor(spread_features, human.variation_noise, human.variation_growth)
    added: FloatArray = np.einsum("nij,nj->ni", human.variation_mean[k], mean_features) + drawn * spread
    return np.clip(added, -human.max_variation_mps2, human.max_variation_mps2)


def spread_factor(features: FloatArray, noise: FloatArray, growth: FloatArray) -> FloatArray:
    """Return (n, N) factors on the deviation of drivers, from their variation and the noise of their boxes.

    Args:
        features: (n, 3) scatter of the accelerations, m/s², and two features of the variation.
        noise: (N,) 1/(m/s²): at a scatter of 1 / noise half of the variance is noise.
        growth: (2,) weights of the features in an exponential.
    """
    return np.asarray(np.hypot(1.0, features[:, :1] * noise) * np.exp(features[:, 1:] @ growth)[:, None])


def node_weights(time_s: float, human: HumanParameters) -> FloatArray:
    """Return (2,) weights of linear interpolation between ``variation_times_s``; the last value goes on."""
    times = human.variation_times_s
    return np.array([np.interp(time_s, times, row) for row in np.eye(len(times))])


def lateral_offsets(
    lateral: FloatArray, target: FloatArray, time_s: FloatArray, human: HumanParameters
) -> FloatArray:
    """Return (n, T) offsets from the path with the least jerk, from the shown motion to the target.

    Args:
        lateral: (n, 3) offset, m, speed, m/s, and acceleration, m/s², at time 0.
        target: (n,) offset after ``lateral_s``, kept from then on, m.
        time_s: (T,).

    Source: Takahashi et al. 1989, the quintic polynomial.
    """
    end = human.lateral_s
    u = np.minimum(time_s / end, 1.0)
    shape = (
        1 - 10 * u**3 + 15 * u**4 - 6 * u**5,
        end * (u - 6 * u**3 + 8 * u**4 - 3 * u**5),
        end**2 * (u**2 - 3 * u**3 + 3 * u**4 - u**5) / 2,
    )
    begun: FloatArray = lateral @ np.stack(shape)
    return np.asarray(begun + target[:, None] * (1 - shape[0]))


def students(uniform: FloatArray) -> FloatArray:
    """Return (n, K) numbers of Student's multivariate distribution with four degrees of freedom.

    ``uniform``: (n, K + 2) K for a normal vector and two for the common χ² with four degrees, -2·ln(u·u').
    """
    chi2 = -2.0 * np.log(uniform[:, -2] * uniform[:, -1])
    return np.asarray(normal_quantiles(uniform[:, :-2]) * np.sqrt(DEGREES / chi2)[:, None])
