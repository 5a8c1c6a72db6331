"""Weights of the models fitted to a recording: the share with which each explains what vehicles did.

Each model plans from moments of the recording. Its error is the difference to the way that the vehicle then
drove, as acceleration. The errors of the model that drives follow a Laplace distribution of one scale; shares
and scale are fitted together by expectation maximization (Dempster, Laird, Rubin 1977). Their intervals come
from a bootstrap over vehicles.
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from scex_sumo.base.arguments import checked
from scex_sumo.base.arrays import FloatArray, IntArray
from scex_sumo.base.errors import ResultError, ScexError, TrackError, UsageError
from scex_sumo.base.files import write_atomic
from scex_sumo.behaviors.base import is_driven_by_sumo
from scex_sumo.behaviors.registry import build, model_specs
from scex_sumo.certainty.options import FITTED
from scex_sumo.certainty.results import TooFewFuturesError, weighted_probability
from scex_sumo.converters.datasets.moment import find_moments
from scex_sumo.converters.datasets.reader import read_clean
from scex_sumo.converters.datasets.scene import CleanRecording, take_scene
from scex_sumo.converters.maps import read_map
from scex_sumo.extrapolation.loop.situations import plans_of
from scex_sumo.results.run import Run
from scex_sumo.road import Road
from scex_sumo.scene import STEP_S, SceneHistory, VehicleIndex

PAST_S: Final = 180.0  # of the recording before the seed moment
EVERY_S: Final = 1.0  # between moments
MAX_MOMENTS: Final = 60
APART_S: Final = 3.0  # of moments from the seed moment: the time of a plan
MOVES_MPS: Final = 1.0  # slower vehicles tell nothing: models that keep still are alike
MIN_WINDOWS: Final = 30
LEAST: Final = 1e-3  # share that is told: weights near 0 are not better known
_TIMES = np.array([1.0, 2.0, 3.0])
_ROUNDS, _BOOTSTRAP = 100, 100


@dataclass(frozen=True, kw_only=True)
class FittedWeights:
    """Weights of the models of a run, fitted to its recording.

    Attributes:
        weights: share by model; ``low`` and ``high`` are its 95 % interval.
        scale: mean error of the model that drives, m/s².
        windows: number of times that a vehicle was seen for 3 s.
        vehicles: number of vehicles that were seen.
        before: whether only the time before the seed moment was seen, else the whole recording.
    """

    weights: dict[str, float]
    low: dict[str, float]
    high: dict[str, float]
    scale: float
    windows: int
    vehicles: int
    before: bool

    @property
    def words(self) -> str:
        """The weights in words."""
        shares = (f"{m} {w:.2f} [{self.low[m]:.2f}–{self.high[m]:.2f}]" for m, w in self.weights.items())
        where = "before the moment" if self.before else "of the whole recording"
        return f"{', '.join(shares)}; {self.windows} plans of {self.vehicles} vehicles {where}"


@checked
def fitted_weights(run: Run) -> FittedWeights:
    """Fit the weights of a run's models to the last minutes of its recording before the seed moment.

    Without enough of them the whole recording counts, but the 3 s about the moment.

    Raises:
        UsageError: the run has no recording, or SUMO drives its models.
        TrackError: the recording tells too little.

    Example:
        >>> sorted(scex.fitted_weights(run).weights)[:2]
        ['constant_velocity', 'emergency_brake']
    """
    source, scene = run.info["seed_scene"].get("source") or {}, run.info["seed_scene"]
    if source.get("kind") != "tracks" or not scene.get("map"):
        raise UsageError("weights of the recording: the seed scene is of no recording; give MODEL=WEIGHT,...")
    names = [entry["model"] for entry in run.info["models"] if entry["weight"] > 0]
    road = read_map(Path(scene["map"]), tracks=Path(source["tracks"]), own_corner=False)
    clean, now = read_clean([Path(source["tracks"])], road), scene["time_s"]
    return weights_of(clean, road, names, now_s=now)


def weights_of(
    clean: CleanRecording, road: Road, names: Sequence[str], *, now_s: float | None = None
) -> FittedWeights:
    """Fit the weights of models to a recording, or to its last minutes before a moment as `fitted_weights`.

    Raises:
        UsageError: SUMO drives the models, or the recording has cases.
        TrackError: the recording tells too little.
    """
    models = [build(spec) for spec in model_specs(",".join(names))]
    if any(map(is_driven_by_sumo, models)):
        raise UsageError("weights of the recording: SUMO drives some of the models; give MODEL=WEIGHT,...")
    if clean.table.has_cases:
        raise UsageError("weights of the recording: its cases are too short; give MODEL=WEIGHT,...")
    now = math.inf if now_s is None else now_s
    ago = {m.time_s: now - m.time_s for m in find_moments(clean.table, every_s=EVERY_S)}
    for before in (True, False):
        asked = [t for t, s in ago.items() if (APART_S <= s <= PAST_S if before else abs(s) >= APART_S)]
        some = asked[:: -(-len(asked) // MAX_MOMENTS)] if asked else []
        errors_by_time = [_errors(clean, road, models, t) for t in some]
        count = sum(len(tracks) for tracks, _ in errors_by_time)
        if count >= MIN_WINDOWS:
            tracks, errors = (np.concatenate(part) for part in zip(*errors_by_time, strict=True))
            return _fit(list(names), tracks, errors, before=before)
    raise TrackError(f"{clean.table.path}: {count} plans of moving vehicles are too few to fit weights")


def _errors(
    clean: CleanRecording, road: Road, models: list[Any], time_s: float
) -> tuple[IntArray, FloatArray]:
    """Return track ids (n,) of the moving vehicles of a moment, and errors (n, M) of each model, m/s²."""
    steps = np.round(_TIMES / STEP_S).astype(np.int64) - 1
    nothing = np.empty(0, dtype=np.int64), np.empty((0, len(models)))
    try:
        scene = take_scene(clean, name="moment", location="", time_s=time_s)
    except ScexError:
        return nothing
    future, valid = scene.future, scene.future_valid
    if future is None or valid is None or future.shape[1] <= steps[-1]:
        return nothing
    scene = dataclasses.replace(scene, road=road)
    moves = (scene.now.speed >= MOVES_MPS) & valid[:, : steps[-1] + 1].all(axis=1)
    vehicle = np.flatnonzero(moves & (scene.recorded_steps >= 5))
    if not len(vehicle):
        return nothing
    who = VehicleIndex(future=np.zeros_like(vehicle), vehicle=vehicle)
    history, rng = SceneHistory.of_scene(scene), [np.random.default_rng(0)]

    def way(x: FloatArray, y: FloatArray) -> FloatArray:
        start = scene.now[vehicle]
        points = [np.concatenate([s[:, None], v], axis=1) for s, v in ((start.x, x), (start.y, y))]
        return np.asarray(np.cumsum(np.hypot(*(np.diff(p, axis=1) for p in points)), axis=1)[:, steps])

    real = way(future.x[vehicle], future.y[vehicle])
    errors = np.empty((len(vehicle), len(models)))
    for index, plan in plans_of(models, [who] * len(models), history, road, rng):
        errors[:, index] = np.mean(2 * np.abs(way(plan.x, plan.y) - real) / _TIMES**2, axis=1)
    return np.asarray(scene.track_ids)[vehicle], errors


def mixture(errors: FloatArray, counts: FloatArray) -> tuple[FloatArray, float]:
    """Return the shares (M,) of a mixture of Laplace distributions with one scale, and the scale.

    Args:
        errors: (N, M) absolute error of each model.
        counts: (N,) how often each row counts.
    """
    share, scale = np.full(errors.shape[1], 1 / errors.shape[1]), float(np.median(errors.min(axis=1))) + 1e-6
    for _ in range(_ROUNDS):
        part = share * np.exp(-(errors - errors.min(axis=1, keepdims=True)) / scale)
        part *= (counts / part.sum(axis=1))[:, None]
        share, scale = part.sum(axis=0) / counts.sum(), float((part * errors).sum() / counts.sum()) + 1e-6
    return share, scale


def _fit(names: list[str], tracks: IntArray, errors: FloatArray, *, before: bool) -> FittedWeights:
    share, scale = mixture(errors, np.ones(len(tracks)))
    vehicles, which = np.unique(tracks, return_inverse=True)
    rng = np.random.default_rng(0)
    drawn = rng.multinomial(len(vehicles), np.full(len(vehicles), 1 / len(vehicles)), size=_BOOTSTRAP)
    again = [mixture(errors, counts[which].astype(np.float64))[0] for counts in drawn]
    low, high = np.quantile(again, (0.025, 0.975), axis=0)
    by_name = [dict(zip(names, values.tolist(), strict=True)) for values in (share, low, high)]
    return FittedWeights(
        weights=by_name[0],
        low=by_name[1],
        high=by_name[2],
        scale=scale,
        windows=len(tracks),
        vehicles=len(vehicles),
        before=before,
    )


def percent_of(share: float | None) -> str:
    """Return P with fitted weights in words, two digits down to 0.1 %."""
    if share is None:
        return "an unknown share"
    return "< 0.1 %" if 0 < share < LEAST else f"{100 * share:.2g} %"


def write_fitted(folder: Path, fitted: FittedWeights) -> None:
    """Write ``fitted_weights.json``."""
    write_atomic(folder / FITTED, json.dumps(dataclasses.asdict(fitted)).encode())


def read_fitted(folder: Path) -> FittedWeights | None:
    """Read the fitted weights of a result folder; None without them."""
    file = folder / FITTED
    if not file.is_file():
        return None
    try:
        return FittedWeights(**json.loads(file.read_bytes()))
    except (OSError, ValueError, TypeError) as error:
        raise ResultError(f"{file}: cannot be read ({str(error)[:80]}); fit the weights again") from None


def answer_of(run: Run) -> dict[str, Any]:
    """Return the fitted weights of a result for JSON, with P of any collision; None where it is not known."""
    fitted, share = read_fitted(run.folder), None
    assert fitted is not None
    with suppress(TooFewFuturesError):
        share = weighted_probability(run, fitted.weights)
    return {**dataclasses.asdict(fitted), "words": fitted.words, "p_collision": share}
