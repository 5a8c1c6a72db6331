"""Assignments of behaviour models to the vehicles of each future."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache

import numpy as np

from scex_sumo.base.arrays import FloatArray, IntArray
from scex_sumo.base.cache import cached_bytes
from scex_sumo.base.errors import UsageError

MAX_COMBINATIONS = 10_000
_ASSIGNMENT_STREAM, _ROUTE_STREAM, _PLAN_STREAM, _DESIGN_STREAM, _, _PEOPLE_STREAM = range(6)


def future_generator(seed: int, future: int, stream: int = _PLAN_STREAM) -> np.random.Generator:
    """Return the random generator of a future, from the run's seed and the future's number alone.

    ``stream`` separates draws of different purpose.
    """
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(future, stream)))


def random_assignments(
    weights: Sequence[float], futures: Sequence[int] | IntArray, vehicles: int, *, seed: int
) -> IntArray:
    """Draw a model (C, V) for every vehicle of every future, independently, by the models' weights (M,)."""
    return _levels(weights, _draws(futures, vehicles, seed, _ASSIGNMENT_STREAM))


def _draws(futures: Iterable[int], count: int, seed: int, stream: int) -> FloatArray:
    """Return numbers (C, count) in [0, 1), of each future alone."""
    return np.stack([future_generator(seed, int(c), stream).random(count) for c in futures])


def _levels(weights: Iterable[float], draws: FloatArray) -> IntArray:
    """Return the model that each number in [0, 1) draws by the models' weights."""
    upper = np.cumsum([*weights])
    return np.searchsorted(upper / upper[-1], draws, side="right").astype(np.int64)


@lru_cache(maxsize=32)
def balanced_assignments(
    weights: tuple[float, ...], futures: int, vehicles: int, *, seed: int, keep: bool = False
) -> IntArray:
    """Draw models (C, V) more evenly than independent draws; the result is shared and must not be changed."""
    drawn = np.flatnonzero(np.asarray(weights, dtype=np.float64) > 0)
    shares = np.asarray(weights, dtype=np.float64)[drawn]
    shares /= shares.sum()

    def make() -> bytes:
        from scex_sumo.statistics.designs import balanced

        generator = future_generator(seed, 0, _DESIGN_STREAM)
        return balanced([shares] * vehicles, futures, generator).tobytes()

    made_of = repr((shares.tolist(), futures, vehicles, seed)).encode()
    levels = cached_bytes("designs", made_of, make) if keep else make()
    return drawn[np.frombuffer(levels, dtype=np.int64).reshape(futures, vehicles)]


def people_assignments(
    weights: Mapping[str, Mapping[int, float]], kinds: Sequence[str], futures: int, *, seed: int
) -> IntArray:
    """Draw a model (C, P) for every person of every future by the weights of the models of its kind."""
    draws = _draws(range(futures), len(kinds), seed, _PEOPLE_STREAM).T
    models = [
        np.array([*weights[kind]])[_levels(weights[kind].values(), own)]
        for kind, own in zip(kinds, draws, strict=True)
    ]
    return np.stack(models, axis=1)


def all_assignments(choices: Sequence[int]) -> IntArray:
    """Return every combination of models (product of choices, V); the last vehicle's model changes fastest.

    Args:
        choices: (V,) number of models that each vehicle may get.
    """
    count = math.prod(int(choice) for choice in choices)
    if count > MAX_COMBINATIONS:
        raise UsageError(
            f"--futures all: {_number(count)} combinations for {len(choices)} vehicles, at most "
            f"{MAX_COMBINATIONS:,} are run; name fewer models, fix some vehicles with --assign, "
            "or give a number of futures"
        )
    grid = np.indices(tuple(int(c) for c in choices), dtype=np.int64)
    return grid.reshape(len(choices), -1).T.copy()


def _number(count: int) -> str:
    return f"{count:,}" if count < 10**6 else f"{count:.3g}" if count < 10**300 else "more than 1e+300"


def assignments(
    weights: Sequence[float],
    track_ids: Sequence[int] | IntArray,
    *,
    futures: int | None,
    seed: int,
    fixed: Mapping[int, int] | None = None,
    keep: bool = False,
) -> IntArray:
    """Return the model (C, V) of every vehicle in every future of a run; fewer futures are the first of more.

    Args:
        weights: (M,) relative frequency of the models to draw from.
        track_ids: (V,).
        futures: number, or None for all combinations.
        fixed: model by track id, the same in all futures; it may lie beyond ``weights``.
        keep: use the user's cache.
    """
    ids, fixed = [int(track) for track in track_ids], fixed or {}
    if futures is None:
        drawn = [i for i, weight in enumerate(weights) if weight > 0]
        picked = all_assignments([1 if t in fixed else len(drawn) for t in ids])
        result = np.asarray(drawn, dtype=np.int64)[picked]
    else:
        free = [v for v, t in enumerate(ids) if t not in fixed]
        result = np.zeros((futures, len(ids)), dtype=np.int64)
        if free:
            result[:, free] = balanced_assignments(tuple(weights), futures, len(free), seed=seed, keep=keep)
    for track, model in fixed.items():
        result[:, ids.index(track)] = model
    return result


def route_draws(futures: Sequence[int] | IntArray, vehicles: int, *, seed: int) -> FloatArray:
    """Return a number in [0, 1) per future and vehicle (C, V), from which models choose random routes."""
    return _draws(futures, vehicles, seed, _ROUTE_STREAM)
