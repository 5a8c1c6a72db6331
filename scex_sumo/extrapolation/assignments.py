"""Assignments of behaviour models to the vehicles of each child."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache

import numpy as np

from scex_sumo.base.arrays import FloatArray, IntArray
from scex_sumo.base.cache import cached_bytes
from scex_sumo.base.errors import UsageError
from scex_sumo.statistics.designs import DESIGNS

MAX_COMBINATIONS = 10_000
_ASSIGNMENT_STREAM, _ROUTE_STREAM, _PLAN_STREAM, _DESIGN_STREAM, EXACT_STREAM = range(5)


def child_generator(seed: int, child: int, stream: int = _PLAN_STREAM) -> np.random.Generator:
    """Return the random generator of a child, which depends on the seed and the child's number alone.

    ``stream`` separates draws of different purpose, so that they do not change each other.
    """
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(child, stream)))


def random_assignments(
    weights: Sequence[float], children: Sequence[int] | IntArray, vehicles: int, *, seed: int
) -> IntArray:
    """Draw a model (C, V) for every vehicle of every child, independently.

    Args:
        weights: (M,) relative frequency of each model, not all zero.
        children: (C,) numbers of the children.
        seed: the run's seed.
    """
    upper = np.cumsum(np.asarray(weights, dtype=np.float64))
    upper /= upper[-1]
    draws = np.stack([child_generator(seed, int(c), _ASSIGNMENT_STREAM).random(vehicles) for c in children])
    return np.searchsorted(upper, draws, side="right").astype(np.int64)


@lru_cache(maxsize=32)
def designed_assignments(
    weights: tuple[float, ...], children: int, vehicles: int, *, seed: int, design: str, keep: bool = False
) -> IntArray:
    """Draw models (C, V) for all children together, spread more evenly than independent draws.

    The result is cached and must not be changed: moments of a ranking with as many vehicles share it.

    Args:
        weights: (M,) relative frequency of each model, not all zero.
        vehicles: V, at least 1.
        seed: the run's seed.
        design: one of ``DESIGNS``.
        keep: use the user's cache.
    """
    drawn = np.flatnonzero(np.asarray(weights, dtype=np.float64) > 0)
    shares = np.asarray(weights, dtype=np.float64)[drawn]
    shares /= shares.sum()

    def make() -> IntArray:
        return DESIGNS[design]([shares] * vehicles, children, child_generator(seed, 0, _DESIGN_STREAM))

    if not keep:
        return drawn[make()].astype(np.int64)
    made_of = repr((shares.tolist(), children, vehicles, seed, design)).encode()
    levels = np.frombuffer(cached_bytes("designs", made_of, lambda: make().tobytes()), dtype=np.int64)
    return drawn[levels.reshape(children, vehicles)]


def all_assignments(choices: Sequence[int]) -> IntArray:
    """Return every combination of models; the last vehicle's model changes fastest.

    Args:
        choices: (V,) number of models that each vehicle may get.

    Returns:
        (product of choices, V) index of the model among the vehicle's choices.

    Raises:
        UsageError: more than ten thousand combinations.
    """
    count = 1
    for choice in choices:
        count *= int(choice)
    if count > MAX_COMBINATIONS:
        raise UsageError(
            f"--children all: {_number(count)} combinations for {len(choices)} vehicles, at most "
            f"{MAX_COMBINATIONS:,} are run; name fewer models, fix some vehicles with --assign, "
            "or give a number of children"
        )
    grid = np.indices(tuple(int(c) for c in choices), dtype=np.int64)
    return grid.reshape(len(choices), -1).T.copy()


def _number(count: int) -> str:
    return f"{count:,}" if count < 10**6 else f"{count:.3g}" if count < 10**300 else "more than 1e+300"


def assignments(
    weights: Sequence[float],
    track_ids: Sequence[int] | IntArray,
    *,
    children: int | None,
    seed: int,
    fixed: Mapping[int, int] | None = None,
    design: str = "random",
    keep: bool = False,
) -> IntArray:
    """Return the model (C, V) of every vehicle in every child of a run.

    Args:
        weights: (M,) relative frequency of the models to draw from.
        track_ids: (V,) of the vehicles.
        children: number of children, or None for all combinations.
        seed: the run's seed.
        fixed: model by track id, the same in all children; its index may lie beyond ``weights``.
        design: how the children are drawn, one of ``DESIGNS``, but for fixed vehicles. With ``random`` and
            ``balanced``, fewer children are the first of more.
        keep: use the user's cache.

    Raises:
        UsageError: an unknown track id, or too many combinations.
    """
    ids = [int(t) for t in track_ids]
    fixed = dict(fixed or {})
    unknown = sorted(set(fixed) - set(ids))
    if unknown:
        raise UsageError(f"--assign: no vehicle {unknown[0]} in the seed scene; its vehicles: {listing(ids)}")
    if children is None:
        drawn = [i for i, weight in enumerate(weights) if weight > 0]
        picked = all_assignments([1 if t in fixed else len(drawn) for t in ids])
        result = np.asarray(drawn, dtype=np.int64)[picked]
    elif design == "random":
        result = random_assignments(weights, range(children), len(ids), seed=seed)
    else:
        free = [v for v, t in enumerate(ids) if t not in fixed]
        result = np.zeros((children, len(ids)), dtype=np.int64)
        if free:
            each = tuple(weights)
            result[:, free] = designed_assignments(
                each, children, len(free), seed=seed, design=design, keep=keep
            )
    for track, model in fixed.items():
        result[:, ids.index(track)] = model
    return result


def route_draws(children: Sequence[int] | IntArray, vehicles: int, *, seed: int) -> FloatArray:
    """Return a number in [0, 1) per child and vehicle (C, V), by which models choose random routes."""
    return np.stack([child_generator(seed, int(c), _ROUTE_STREAM).random(vehicles) for c in children])


def listing(ids: Sequence[int], most: int = 12) -> str:
    """Return ids as text, the first few of many."""
    shown = ", ".join(str(i) for i in ids[:most])
    return shown if len(ids) <= most else f"{shown}, ... ({len(ids)} in all)"
