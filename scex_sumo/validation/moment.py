"""Moment in a worker: its children beside what really happened, measured by the same code."""

from __future__ import annotations

import dataclasses
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import pyarrow as pa

from scex_sumo.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.converters.net.convert import SumoNet
from scex_sumo.errors import TrackError
from scex_sumo.extrapolation.job import Job, parts_in_memory
from scex_sumo.extrapolation.measure import measure_outcome, measure_recorded, recorded_steps_of
from scex_sumo.extrapolation.models import ModelSet
from scex_sumo.extrapolation.rollout import Rollout
from scex_sumo.extrapolation.settings import RunSettings
from scex_sumo.ranking.moments import Failure
from scex_sumo.ranking.run_moment import MomentTask, compared, worked
from scex_sumo.ranking.settings import built
from scex_sumo.road import Road
from scex_sumo.roads.routes import off_road
from scex_sumo.scene import SeedScene, States
from scex_sumo.validation.noise import BoxNoise, as_recorded
from scex_sumo.validation.realism import realism, realism_score
from scex_sumo.validation.vehicles import gap_forecasts, position_forecasts

RECORDED, CONSTANT_VELOCITY, SEED_MOMENT = -1, -2, -3
"""Children of a moment that are none: what happened, constant velocity, the first step of that."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Forecast:
    """One moment: what the children say, and what happened.

    Attributes:
        children: metric columns and ``collision`` of each child, and of `RECORDED` and the other two.
        seen: the same of each child as it would have been recorded, see `as_recorded`.
        vehicles: see `position_forecasts`.
        encounters: see `gap_forecasts`.
        realism: one row: its score and the likelihood of each feature.
    """

    children: pa.Table
    seen: pa.Table
    vehicles: pa.Table
    encounters: pa.Table
    realism: pa.Table


@dataclass(frozen=True, kw_only=True, eq=False)
class ForecastTask(MomentTask):
    """A moment to be forecast.

    Attributes:
        noise: errors of the boxes of its recording.
    """

    noise: BoxNoise

    @classmethod
    def of(cls, task: MomentTask, noise: BoxNoise) -> ForecastTask:
        """A task of a ranking as one of a validation."""
        given = {field.name: getattr(task, field.name) for field in dataclasses.fields(task)}
        return cls(**given, noise=noise)


def validate_moment(task: ForecastTask, road: bytes | None = None) -> Forecast | Failure:
    """Run the children of a task beside its recording; or what is wrong with the moment."""
    return worked(partial(_forecast, task.noise), task, road)


def _forecast(noise: BoxNoise, task: MomentTask, road: Road, net: SumoNet) -> Forecast:
    scene = dataclasses.replace(task.scene, road=road)
    if len(off_road(road, scene)) == scene.vehicles:
        raise TrackError(f"none of its {scene.vehicles} vehicles is on a mapped lane; check the map's origin")
    steps = task.settings.steps
    judged = _recorded_to_end(scene, steps)
    if not judged.any():
        raise TrackError(f"no vehicle is recorded for {steps} steps after it; take another moment")
    asked = dataclasses.replace(task.settings.run, preset="both", metrics=None, keep_plans=True)
    plain = RunSettings(
        models="constant_velocity", children=1, steps=steps, keep_plans=False, world=asked.world
    )
    # Who leaves the recording leaves the children at the same step: like is compared with like.
    run = partial(_run, scene, net, compared(net, task.ref))
    children = run(asked, built(task.settings.models), len(task.children))
    straight = run(plain, ModelSet.of(plain), 1)
    first = run(dataclasses.replace(plain, steps=1), ModelSet.of(plain), 1)
    recorded = measure_recorded(scene, steps, metrics=asked.measured, preset=asked.rule)
    assert recorded is not None and scene.future is not None
    after = scene.future[:, :steps].repeat(1).swapaxes(1, 2)
    known = np.where(recorded.values.defined, recorded.values.values, np.nan)
    rng = np.random.default_rng(zlib.crc32(task.ref.moment.encode()))
    seen = _seen(scene, asked, children, noise, rng)
    own = np.arange(len(task.children))
    rows = [
        (own, children.values, children.collided),
        (np.array([RECORDED]), known, recorded.overlaps.any_of(1)),
        (np.array([CONSTANT_VELOCITY]), straight.values, straight.collided),
        (np.array([SEED_MOMENT]), first.values, first.collided),
    ]
    likelihood = realism(children.states, after, scene.length, scene.width, judged, road)
    return Forecast(
        children=_children_table(asked.columns, rows),
        seen=_children_table(asked.columns, [(own, seen.values, seen.collided)]),
        vehicles=position_forecasts(scene, children.states, seen.states, straight.states, judged, rng),
        encounters=gap_forecasts(scene, children.states, seen.states, straight.states, after, judged, rng),
        realism=pa.table({"realism": [realism_score(likelihood)], **{k: [v] for k, v in likelihood.items()}}),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Children:
    driven: Rollout
    values: FloatArray
    collided: BoolArray

    @property
    def states(self) -> States:
        return self.driven.states


def _run(
    scene: SeedScene, net: SumoNet, compared: bool, settings: RunSettings, models: ModelSet, count: int
) -> _Children:
    models.try_on(scene, seed=settings.seed)
    drawn = models.draw(scene.track_ids, children=count, seed=settings.seed, design=settings.design)
    counted = recorded_steps_of(scene, settings.steps)
    job = Job(scene, net, settings, models, drawn, net.path.parent, counted=counted, compared=compared)
    parts = parts_in_memory(job, range(count))
    hit = [
        np.asarray(part.collisions["child"], dtype=np.int64) for part in parts if part.collisions is not None
    ]
    collided = np.zeros(count, dtype=bool)
    for children in hit:
        collided[children] = True
    return _Children(
        collided=collided,
        driven=Rollout(
            children=np.concatenate([part.children for part in parts]),
            states=States.concatenate([part.states for part in parts], axis=0),
            plan_x=_joined([part.plan_x for part in parts]),
            plan_y=_joined([part.plan_y for part in parts]),
            replan=settings.replan,
        ),
        values=np.concatenate([np.where(part.defined, part.values, np.nan) for part in parts]),
    )


def _joined(plans: Sequence[FloatArray | None]) -> FloatArray:
    """Plans of all batches; none where they were not kept."""
    return np.concatenate([plan for plan in plans if plan is not None] or [np.empty(0)])


def _seen(
    scene: SeedScene,
    settings: RunSettings,
    children: _Children,
    noise: BoxNoise,
    rng: np.random.Generator,
) -> _Children:
    """Children as they would have been recorded, measured."""
    seen = as_recorded(scene, children.driven, noise, rng)
    counted = recorded_steps_of(scene, settings.steps)
    found = measure_outcome(scene, seen, metrics=settings.measured, preset=settings.rule, counted=counted)
    collided = np.zeros(len(seen.children), dtype=bool)
    collided[found.collisions.child] = True
    values = np.where(found.values.defined, found.values.values, np.nan)
    return _Children(driven=seen, values=values, collided=collided)


def _recorded_to_end(scene: SeedScene, steps: int) -> BoolArray:
    """(V,) vehicles with a recorded future of so many steps."""
    if scene.future_valid is None or scene.future_valid.shape[1] < steps:
        return np.zeros(scene.vehicles, dtype=bool)
    whole: BoolArray = np.all(scene.future_valid[:, :steps], axis=1)
    return whole


def _children_table(columns: tuple[str, ...], rows: list[tuple[IntArray, FloatArray, BoolArray]]) -> pa.Table:
    values = np.concatenate([part[1] for part in rows])
    data = {"child": pa.array(np.concatenate([part[0] for part in rows]), pa.int32())}
    for index, name in enumerate(columns):
        data[name] = pa.array(values[:, index], mask=np.isnan(values[:, index]))
    data["collision"] = pa.array(np.concatenate([part[2] for part in rows]))
    return pa.table(data)
