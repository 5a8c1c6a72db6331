"""Metric values, collisions and encounters of simulated and of recorded vehicles."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.base.owned import owner_cache
from scex_sumo.behaviors.models.simple import Replay
from scex_sumo.extrapolation.loop.crashes import uncounted
from scex_sumo.extrapolation.loop.rollout import Batch, Rollout, roll_out
from scex_sumo.geometry.rectangles import Rectangles, overlap_area
from scex_sumo.metrics.base import PlannedPaths, SceneTracks
from scex_sumo.metrics.collisions import CONTACT_M2, OVERLAP_M2, Collisions, find_collisions
from scex_sumo.metrics.encounters import Encounters, encounters_of
from scex_sumo.metrics.evaluate import ScenarioValues, evaluate
from scex_sumo.metrics.pairs.scenes import Scenes
from scex_sumo.metrics.registry import Metric
from scex_sumo.results.participants import everybody, with_everybody
from scex_sumo.results.tables.outcomes import Severity, severity_of
from scex_sumo.scene import HISTORY_STEPS, LOGGED_HISTORY, STEP_S, SeedScene, States
from scex_sumo.world.plain import PlainWorld

if TYPE_CHECKING:
    from scex_sumo.conflicts.pairs import Conflicts

P = TypeVar("P", Collisions, Encounters)


@dataclass(frozen=True, kw_only=True, eq=False)
class Outcome:
    """Metric values, collisions with their severity, and encounters of a batch."""

    values: ScenarioValues
    collisions: Collisions
    severity: Severity
    encounters: Encounters


@dataclass(frozen=True, kw_only=True, eq=False)
class Recorded:
    """The recorded future, measured like a future.

    Attributes:
        overlaps: of boxes after the seed moment; recorded boxes are inexact.
        encounters: one that overlaps has collided.
        last_step: (V,) steps in which a vehicle is recorded.
    """

    values: ScenarioValues
    overlaps: Collisions
    encounters: Encounters
    last_step: IntArray
    steps: int


def measure_outcome(
    scene: SeedScene,
    rollout: Rollout,
    *,
    metrics: Sequence[Metric] | None = None,
    counted: BoolArray | None = None,
    vehicles: Collection[int] | None = None,
    on_paths: bool = True,
) -> Outcome:
    """Measure a batch of futures by the metrics, or by the paper's six.

    Args:
        counted: (T, V) steps in which a vehicle counts; None: all.
        vehicles: only pairs with one of these (indices) count; None: all.
        on_paths: encounters have TTC, PET and DRAC, too.
    """
    tracks, planned = evaluated_tracks(scene, rollout, counted)
    hits = find_collisions(tracks, limit_m2=CONTACT_M2)
    # What hits one of these later is no consequence.
    hits = hits.take(np.flatnonzero(~uncounted(scene)[hits.first, hits.second]))
    hits = _of_pairs(hits.with_consequences() if rollout.with_crashes else hits, vehicles)
    values, met = _evaluated(tracks, planned, hits, metrics, vehicles, on_paths=on_paths)
    severity = severity_of(tracks, hits, scene.types, scene.road)
    return Outcome(values=values, collisions=hits, severity=severity, encounters=met)


def _evaluated(
    tracks: SceneTracks,
    planned: PlannedPaths,
    hits: Collisions,
    metrics: Sequence[Metric] | None,
    vehicles: Collection[int] | None,
    *,
    on_paths: bool = True,
) -> tuple[ScenarioValues, Encounters]:
    met: list[Encounters] = []

    def meet(start: int, scenes: Scenes) -> None:
        met.append(_of_pairs(encounters_of(scenes, hits, start, on_paths=on_paths), vehicles))

    values = evaluate(tracks, planned, metrics=metrics, vehicles=vehicles, also=meet)
    return values, Encounters.join(met)


def measure_conflicts(scene: SeedScene, rollout: Rollout, *, vehicle: int | None = None) -> Conflicts:
    """Return the conflicts of a batch; vehicles by index into `everybody` of the scene.

    Args:
        vehicle: only those with this one; None: all.
    """
    from scex_sumo.conflicts.pairs import find_conflicts

    states, whole = with_everybody(scene, rollout.states), everybody(scene)
    after = rollout.states.shape[1] % rollout.replan or rollout.replan
    plan = np.stack([rollout.plan_x, rollout.plan_y])[:, :, -1, :, after:]
    left = np.full((states.shape[0], whole.vehicles), rollout.states.shape[1])
    if rollout.present is not None:
        left[:, : scene.vehicles] = rollout.present.sum(axis=1)
        states, plan = _until_they_leave(states, left, plan)
    last = states[:, -1, scene.vehicles :]
    travelled_m = last.speed[..., None] * STEP_S * np.arange(1, plan.shape[-1] + 1)
    people = last.ahead(travelled_m, travelled_m)
    conflicts = find_conflicts(
        states,
        whole.length,
        whole.width,
        np.concatenate([plan, [people.x, people.y]], axis=2),
        now=HISTORY_STEPS,
        people=whole.people,
        vehicle=vehicle,
    )
    nets = np.zeros((whole.vehicles, whole.vehicles), np.bool_)
    nets[: scene.vehicles, : scene.vehicles] = uncounted(scene)
    conflicts = conflicts.take(np.flatnonzero(~nets[conflicts.one, conflicts.two]))
    return conflicts if rollout.present is None else conflicts.before(left)


def _until_they_leave(states: States, left: IntArray, plan: FloatArray) -> tuple[States, FloatArray]:
    """Return states and plans in which vehicles that have arrived stay where they were seen last."""
    step = np.minimum(np.arange(states.shape[1])[:, None], HISTORY_STEPS + left[:, None])
    states = states.map(lambda values: np.take_along_axis(values, step, axis=1))
    gone, last = left[:, : plan.shape[2]] < states.shape[1] - HISTORY_STEPS - 1, states[:, -1]
    stay = np.stack([last.x, last.y])[:, :, : plan.shape[2], None]
    return states, np.where(gone[..., None], stay, plan)


def _of_pairs(rows: P, vehicles: Collection[int] | None) -> P:
    """Select collisions or encounters with one of the vehicles."""
    if vehicles is None:
        return rows
    return rows.take(np.flatnonzero(np.isin([rows.first, rows.second], list(vehicles)).any(axis=0)))


@owner_cache
def measure_recorded(
    scene: SeedScene,
    steps: int,
    *,
    replan: int = 5,
    metrics: tuple[Metric, ...] | None = None,
    vehicles: tuple[int, ...] | None = None,
) -> Recorded | None:
    """Measure the recorded future as one row; return None if there is none.

    `Replay` drives every vehicle in a plain world, as long as it was recorded.
    """
    if scene.future is None or scene.future_valid is None or scene.future.shape[1] == 0:
        return None
    assert scene.road is not None
    future, count = np.zeros(1, dtype=np.int64), scene.vehicles
    batch = Batch(
        futures=future,
        assignment=np.zeros((1, count), dtype=np.int64),
        models=[Replay()],
        names=["replay"],
        overridden=np.ones(1, dtype=np.bool_),
        route_draw=np.zeros((1, count)),
        generators=[np.random.default_rng(0)],
    )
    rollout = roll_out(
        PlainWorld(1, count), scene.road, scene, batch, steps=steps, replan=replan, crash=False
    )
    counted = recorded_steps_of(scene, steps)
    tracks, planned = evaluated_tracks(scene, rollout, counted)
    overlaps, last = _of_pairs(find_collisions(tracks), vehicles), counted.sum(axis=0)
    values, met = _evaluated(tracks, planned, overlaps, metrics, vehicles)
    return Recorded(values=values, overlaps=overlaps, encounters=met, last_step=last, steps=steps)


def recorded_steps_of(scene: SeedScene, steps: int) -> BoolArray:
    """Return the steps (T, V) after the seed moment up to a vehicle's first gap."""
    assert scene.future_valid is not None
    known = np.cumprod(scene.future_valid, axis=1).sum(axis=1)
    result: BoolArray = np.arange(steps)[:, None] < np.minimum(known, steps)
    return result


def overlapping_at_first(scene: SeedScene) -> list[tuple[int, int]]:
    """Return the pairs of vehicles (indices) whose boxes overlap at the seed moment."""
    now, (first, second) = scene.now, np.triu_indices(scene.vehicles, 1)
    boxes = [Rectangles.of(now[side], scene.length[side], scene.width[side]) for side in (first, second)]
    overlapping = np.flatnonzero(overlap_area(*boxes) > OVERLAP_M2)
    return list(zip(first[overlapping].tolist(), second[overlapping].tolist(), strict=True))


def evaluated_tracks(
    scene: SeedScene, rollout: Rollout, counted: BoolArray | None = None
) -> tuple[SceneTracks, PlannedPaths]:
    """Return the tracks and plans of a batch; ``counted`` as of `measure_outcome`."""
    count, steps, _ = rollout.states.shape
    # As many steps as in tracks.parquet, so that both give the same values.
    past = scene.history.repeat(count)[:, :, -LOGGED_HISTORY:].swapaxes(1, 2)
    present = rollout.present
    if counted is not None:
        present = counted[None].repeat(count, axis=0) if present is None else counted & present
    if present is not None:
        present = np.concatenate([np.ones(past.shape, dtype=bool), present], axis=1)
    tracks = SceneTracks(
        states=States.concatenate([past, rollout.states], axis=1),
        length=scene.length,
        width=scene.width,
        present=present,
        step_s=STEP_S,
        first=past.shape[1],
        types=scene.types,
    )
    made_at = np.arange(0, steps, rollout.replan, dtype=np.int64)
    return tracks, PlannedPaths.from_replans(rollout.plan_x, rollout.plan_y, made_at, steps)
