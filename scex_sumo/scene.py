"""The data that flows between the parts: states, seed scene, history, plan.

Units throughout: metres, radians, seconds. Positions are vehicle centres in the map's own coordinates;
``heading`` is 0 along +x and grows counter-clockwise; ``speed`` is in m/s along the heading.
Axes are named C (child), V (vehicle), T (step), H (planned step), n (vehicles that plan in one call).
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from scex_sumo.arrays import BoolArray, FloatArray, IntArray

if TYPE_CHECKING:
    from scex_sumo.road import Road


STEP_S = 0.1
HISTORY_STEPS = 10  # steps back; a history holds one state more, the present one


@dataclass(frozen=True, kw_only=True, eq=False)
class States:
    """Poses and speeds, four arrays of one shape.

    Attributes:
        x: centre, m.
        y: centre, m.
        heading: rad, 0 = +x, counter-clockwise.
        speed: m/s along the heading.
    """

    x: FloatArray
    y: FloatArray
    heading: FloatArray
    speed: FloatArray

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape shared by the four arrays."""
        return self.x.shape

    def map(self, function: Callable[[FloatArray], FloatArray]) -> States:
        """The same function applied to each of the four arrays."""
        return States(
            x=function(self.x),
            y=function(self.y),
            heading=function(self.heading),
            speed=function(self.speed),
        )

    def __getitem__(self, key: Any) -> States:
        return self.map(lambda values: values[key])

    def repeat(self, count: int) -> States:
        """The same states ``count`` times, along a new first axis."""
        return self.map(lambda values: np.repeat(values[None], count, axis=0))

    def swapaxes(self, first: int, second: int) -> States:
        """The same states with two axes exchanged."""
        return self.map(lambda values: values.swapaxes(first, second))

    @classmethod
    def empty(cls, shape: tuple[int, ...]) -> States:
        """Uninitialised states of a shape."""
        return cls(x=np.empty(shape), y=np.empty(shape), heading=np.empty(shape), speed=np.empty(shape))

    @classmethod
    def concatenate(cls, parts: Sequence[States], axis: int) -> States:
        """Join states along an existing axis."""
        return cls.joined(parts, lambda arrays: np.concatenate(arrays, axis))

    @classmethod
    def stack(cls, parts: Sequence[States], axis: int) -> States:
        """Join states along a new axis."""
        return cls.joined(parts, lambda arrays: np.stack(arrays, axis))

    @staticmethod
    def joined(parts: Sequence[States], join: Callable[[list[FloatArray]], FloatArray]) -> States:
        """Each of the four arrays made of those of all parts."""
        return States(
            x=join([p.x for p in parts]),
            y=join([p.y for p in parts]),
            heading=join([p.heading for p in parts]),
            speed=join([p.speed for p in parts]),
        )

    def assign(self, key: Any, other: States) -> None:
        """Write ``other`` into the arrays in place at ``key``."""
        self.x[key] = other.x
        self.y[key] = other.y
        self.heading[key] = other.heading
        self.speed[key] = other.speed


@dataclass(frozen=True, kw_only=True, eq=False)
class Obstacles:
    """Pedestrians and cyclists of the seed scene: replayed, seen by drivers, not measured.

    Attributes:
        ids: (O,) names as recorded.
        types: (O,) as recorded, lower case, e.g. ``pedestrian/bicycle``.
        length: (O,) m.
        width: (O,) m.
        states: (O, 11 + F); index 10 is the moment of the seed scene. Where the recording ends, the last
            motion is continued at constant velocity.
        present: (O, 11 + F) False where the participant was not on the scene.
    """

    ids: tuple[str, ...]
    types: tuple[str, ...]
    length: FloatArray
    width: FloatArray
    states: States
    present: BoolArray


@dataclass(frozen=True, kw_only=True, eq=False)
class SeedScene:
    """One moment of traffic: every vehicle's pose, speed and size, and its last second.

    Attributes:
        name: short, fit for a file name, e.g. ``k733_2020-09-15_000_t60.0``.
        location: name of the map or site.
        time_s: the moment, in the recording's own clock.
        track_ids: (V,) as recorded.
        types: (V,) ``car``, ``truck``, ... lower case.
        length: (V,) m.
        width: (V,) m.
        history: (V, 11) oldest first; the last column is the moment itself.
        recorded_steps: (V,) how many of the 10 previous steps were recorded; the others are a
            constant-velocity backcast.
        future: (V, F) what really happened from the next step on, or None where nothing was recorded.
        future_valid: (V, F) False after a vehicle has left the recording.
        obstacles: other participants, or None.
        notes: what a reader repaired, padded or left out, one short sentence each.
        source: where it came from, for ``run.json``.
        road: the map, where the scene was read together with one.
    """

    name: str
    location: str
    time_s: float
    track_ids: IntArray
    types: tuple[str, ...]
    length: FloatArray
    width: FloatArray
    history: States
    recorded_steps: IntArray
    future: States | None = None
    future_valid: BoolArray | None = None
    obstacles: Obstacles | None = None
    notes: tuple[str, ...] = ()
    source: dict[str, Any] = field(default_factory=dict)
    road: Road | None = None

    def __repr__(self) -> str:
        future = 0 if self.future is None else self.future.shape[1]
        return f"SeedScene({self.name!r}: {self.vehicles} vehicles, {future} steps recorded after it)"

    def _repr_html_(self) -> str:
        return str(importlib.import_module("scex_sumo.reports.notebook").scene_html(self))

    @property
    def vehicles(self) -> int:
        """Number of vehicles V."""
        return len(self.track_ids)

    def reordered(self, order: Sequence[int], *, name: str) -> SeedScene:
        """The same scene under another name with these of its vehicles (indices) in this order."""
        index = np.asarray(order, dtype=np.int64)
        return replace(
            self,
            name=name,
            track_ids=self.track_ids[index],
            types=tuple(self.types[i] for i in index),
            length=self.length[index],
            width=self.width[index],
            history=self.history[index],
            recorded_steps=self.recorded_steps[index],
            future=None if self.future is None else self.future[index],
            future_valid=None if self.future_valid is None else self.future_valid[index],
        )

    @property
    def now(self) -> States:
        """(V,) the moment itself."""
        return self.history[:, -1]


@dataclass(frozen=True, kw_only=True, eq=False)
class SceneHistory:
    """What behaviour models see: all vehicles of a batch of children, now and 10 steps back.

    Attributes:
        scene: the seed scene; sizes, types and everything that does not depend on the child.
        states: (C, V, 11) read back from SUMO, oldest first, newest last.
        children: (C,) numbers of the children in this batch.
        step: steps since the seed scene (0 = first plan).
        route_draw: (C, V) in [0, 1), fixed for a vehicle of a child; models with random routes use it.
        obstacle_states: (O,) now; None without obstacles.
        obstacle_present: (O,) now; None without obstacles.
    """

    scene: SeedScene
    states: States
    children: IntArray
    step: int
    route_draw: FloatArray
    obstacle_states: States | None = None
    obstacle_present: BoolArray | None = None

    @classmethod
    def of_scene(cls, scene: SeedScene) -> SceneHistory:
        """A seed scene as the only child of a batch; its ``route_draw`` is zero."""
        others = scene.obstacles
        return cls(
            scene=scene,
            states=scene.history.repeat(1),
            children=np.zeros(1, dtype=np.int64),
            step=0,
            route_draw=np.zeros((1, scene.vehicles)),
            obstacle_states=None if others is None else others.states[:, HISTORY_STEPS],
            obstacle_present=None if others is None else others.present[:, HISTORY_STEPS],
        )

    @property
    def now(self) -> States:
        """(C, V) present states."""
        return self.states[:, :, -1]


@dataclass(frozen=True, kw_only=True, eq=False)
class Who:
    """Which vehicles plan in one call: index arrays into (C, V).

    Attributes:
        child: (n,) index into the batch (not the child's number).
        vehicle: (n,) index into the seed scene's vehicles.
    """

    child: IntArray
    vehicle: IntArray

    def __len__(self) -> int:
        return len(self.child)

    def __getitem__(self, key: Any) -> Who:
        return Who(child=self.child[key], vehicle=self.vehicle[key])


@dataclass(frozen=True, kw_only=True, eq=False)
class Plan(States):
    """Intended future states of n vehicles, (n, H >= 30); column 0 is the next step (0.1 s ahead).

    Attributes:
        fallback: (n,) True where the model had no usable plan and the path-following driver planned instead;
            None where that cannot happen.
        reasons: (n) why, a phrase for each vehicle, empty where the model's own plan stands; or nothing at
            all where no reason is known.
    """

    fallback: BoolArray | None = None
    reasons: tuple[str, ...] = ()


LOGGED_HISTORY = 10  # frames of an INTERACTION case up to and including the seed scene
