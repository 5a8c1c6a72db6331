"""Data types that all parts share: states, seed scene, history, plan.

Units are metres, radians, seconds. Positions are vehicle centres in the map's coordinates. ``heading`` is 0
along +x and grows counter-clockwise. Axes: C (future), V (vehicle), T (step), O (obstacle), H (planned step),
n (vehicles that plan in one call).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray, Rows
from scex_sumo.base.errors import UsageError, listed
from scex_sumo.base.owned import SentOnce

if TYPE_CHECKING:
    from scex_sumo.intention import Intention, Walk
    from scex_sumo.road import Road
    from scex_sumo.road_rules import Rules


STEP_S = 0.1
HISTORY_STEPS = 10  # a history has one more state, the present one
REPLAYED = "replayed"  # type of a vehicle that moves as recorded
LOGGED_HISTORY = 10  # frames up to and including the seed scene


@dataclass(frozen=True, kw_only=True, eq=False)
class States:
    """Poses and speeds, four arrays of one shape; the speed is along the heading.

    Example:
        >>> scene = scex.read_seed(scex.example_path("roundabout"))
        >>> scene.now.speed.shape
        (14,)
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
        """Apply a function to each of the four arrays."""
        return States.joined([self], lambda arrays: function(arrays[0]))

    def __getitem__(self, key: Any) -> States:
        return States(x=self.x[key], y=self.y[key], heading=self.heading[key], speed=self.speed[key])

    def repeat(self, count: int) -> States:
        """Repeat the states along a new first axis."""
        return self.map(lambda values: np.repeat(values[None], count, axis=0))

    def swapaxes(self, first: int, second: int) -> States:
        """Exchange two axes."""
        return self.map(lambda values: values.swapaxes(first, second))

    def ahead(self, distance_m: FloatArray, speed: FloatArray) -> States:
        """Return states (..., T) straight ahead of these (...), by ways (..., T), m, with speeds (..., T)."""
        return States(
            x=self.x[..., None] + distance_m * np.cos(self.heading)[..., None],
            y=self.y[..., None] + distance_m * np.sin(self.heading)[..., None],
            heading=np.repeat(self.heading[..., None], distance_m.shape[-1], axis=-1),
            speed=speed,
        )

    def ahead_and_left(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return how far places (n..., k...) are ahead of these states (n...), and to their left, m."""
        frame = (..., *(None,) * (np.ndim(x) - np.ndim(self.x)))
        cos, sin = np.cos(self.heading)[frame], np.sin(self.heading)[frame]
        dx, dy = x - self.x[frame], y - self.y[frame]
        return cos * dx + sin * dy, cos * dy - sin * dx

    @classmethod
    def empty(cls, shape: tuple[int, ...]) -> States:
        """Allocate states without values."""
        return cls(x=np.empty(shape), y=np.empty(shape), heading=np.empty(shape), speed=np.empty(shape))

    @staticmethod
    def concatenate(parts: Sequence[States], axis: int) -> States:
        """Join states along an existing axis."""
        return States.joined(parts, lambda arrays: np.concatenate(arrays, axis))

    @staticmethod
    def stack(parts: Sequence[States], axis: int) -> States:
        """Join states along a new axis."""
        return States.joined(parts, lambda arrays: np.stack(arrays, axis))

    @staticmethod
    def joined(parts: Sequence[States], join: Callable[[list[FloatArray]], FloatArray]) -> States:
        """Make each of the four arrays from those of all parts."""
        names = "x", "y", "heading", "speed"
        return States(**{name: join([getattr(states, name) for states in parts]) for name in names})

    def assign(self, key: Any, other: States) -> None:
        """Write ``other`` into the arrays at ``key``, in place."""
        self.x[key], self.y[key] = other.x, other.y
        self.heading[key], self.speed[key] = other.heading, other.speed


@dataclass(frozen=True, kw_only=True, eq=False)
class Obstacles:
    """Pedestrians and cyclists of the seed scene: replayed, visible to models, not part of the metrics."""

    ids: tuple[str, ...]  # (O,) names
    types: tuple[str, ...]  # (O,) lower case, e.g. ``pedestrian/bicycle``
    length: FloatArray
    width: FloatArray
    states: States  # (O, 11 + F); index 10 is the seed scene; constant velocity continues the recording
    present: BoolArray  # (O, 11 + F)
    # (O,) of pedestrians of a simulation, from the edge where they are, or were last; () else
    walks: tuple[Walk, ...] = ()

    def at(self, step: int) -> tuple[States, BoolArray]:
        """Return states (O,) and presence ``step`` steps after the seed scene; the last ones stay."""
        column = min(HISTORY_STEPS + step, self.states.shape[1] - 1)
        return self.states[:, column], self.present[:, column]


@dataclass(frozen=True, kw_only=True, eq=False)
class SeedScene(SentOnce):
    """Seed scene, one moment of traffic: pose, speed, size and last second of every vehicle.

    Attributes:
        name: valid in file names, e.g. ``k733_2020-09-15_000_t60.0``.
        location: name of the map or site.
        time_s: on the recording's clock.
        types: (V,) lower case, e.g. ``car``, ``truck``.
        length: (V,) m; so ``width``.
        history: (V, 11) oldest first; the last column is the moment itself.
        recorded_steps: (V,) recorded ones of the 10 previous steps; constant velocity gives the others.
        future: (V, F) recorded states from the next step on; None if there are none.
        future_valid: (V, F) False after a vehicle has left the recording.
        notes: repairs and omissions, one short sentence each.
        source: origin of the data, for ``run.json``.
        road: the map, if the scene was read together with one.
        intentions: (V,) what SUMO knows of each vehicle of its simulation; () for recordings.
        rules: lights and right of way that drivers obey; None: none.
        people: (V,) pedestrians and cyclists that take part; pairs of two do not count. None: nobody.
        horizon_s: least time of futures for which the paths of vehicles are looked for.

    Example:
        >>> scene = scex.read_seed(scex.example_path("roundabout"))
        >>> scene.name, scene.vehicles, scene.history.x.shape
        ('roundabout_t4.5', 14, (14, 11))
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
    intentions: tuple[Intention | None, ...] = ()
    rules: Rules | None = None
    people: BoolArray | None = None
    horizon_s: float = 3.0

    def __repr__(self) -> str:
        future = 0 if self.future is None else self.future.shape[1]
        return f"SeedScene({self.name!r}: {self.vehicles} vehicles, {future} steps recorded after it)"

    @property
    def time(self) -> float:
        """Another word for ``time_s``, as `scex_sumo.read_seed` has it."""
        return self.time_s

    @property
    def vehicles(self) -> int:
        """Number of vehicles V."""
        return len(self.track_ids)

    def reordered(self, order: Sequence[int], *, name: str) -> SeedScene:
        """Select vehicles by index in a new order, under another scene name."""
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
            intentions=tuple(self.intentions[i] for i in index) if self.intentions else (),
            people=None if self.people is None else self.people[index],
        )

    @property
    def names(self) -> list[str]:
        """(V,) SUMO's names of the vehicles of a simulation, else the track ids."""
        return [str(named(self.source, track)) for track in self.track_ids.tolist()]

    def track_of(self, name: int | str, option: str) -> int:
        """Return the track id of a vehicle by SUMO's name or by the id; `UsageError` of an option without."""
        known = dict(zip(map(str, self.names), self.track_ids.tolist(), strict=True))
        known = {str(track): track for track in known.values()} | known
        if str(name) not in known:
            raise UsageError(f"{option} {name}: not in the seed scene; its vehicles: {listed(self.names)}")
        return int(known[str(name)])

    def intention(self, vehicle: int) -> Intention | None:
        """Return what SUMO knows of a vehicle by its index; None for recordings."""
        return self.intentions[vehicle] if self.intentions else None

    @property
    def now(self) -> States:
        """(V,) states at the moment itself."""
        return self.history[:, -1]


def named(source: Mapping[str, Any], track: int) -> int | str:
    """Return SUMO's name of a vehicle of a simulation, by the scene's source; else its track id."""
    name: int | str = (source.get("vehicles") or {}).get(str(track), track)
    return name


@dataclass(frozen=True, kw_only=True, eq=False)
class SceneHistory:
    """Input of behaviour models: all vehicles of a batch of futures, now and 10 steps back.

    Attributes:
        scene: the seed scene: all that does not depend on the future.
        states: (C, V, 11) read back from SUMO, oldest first.
        futures: (C,) numbers.
        step: steps since the seed scene.
        route_draw: (C, V) in [0, 1), fixed per vehicle of a future, for models with random routes.

    Example:
        >>> scex.SceneHistory.__dataclass_fields__["states"].type
        'States'
    """

    scene: SeedScene
    states: States
    futures: IntArray
    step: int
    route_draw: FloatArray

    @classmethod
    def of_scene(cls, scene: SeedScene) -> SceneHistory:
        """Make a batch of one future from a seed scene; its ``route_draw`` is zero."""
        return cls(
            scene=scene,
            states=scene.history.repeat(1),
            futures=np.zeros(1, dtype=np.int64),
            step=0,
            route_draw=np.zeros((1, scene.vehicles)),
        )

    def part(self, futures: IntArray | slice) -> SceneHistory:
        """Return the history of some futures, by index."""
        return replace(
            self,
            states=self.states[futures],
            futures=self.futures[futures],
            route_draw=self.route_draw[futures],
        )

    @property
    def now(self) -> States:
        """(C, V) present states."""
        return self.states[:, :, -1]


@dataclass(frozen=True, kw_only=True, eq=False)
class VehicleIndex(Rows):
    """Vehicles that plan in one call, as index arrays into (C, V).

    Attributes:
        future: (n,) index into the batch, not the future's number.
        vehicle: (n,) index into the seed scene's vehicles.

    Example:
        >>> vehicles = scex.VehicleIndex(future=np.array([0, 1]), vehicle=np.array([3, 3]))
        >>> len(vehicles)
        2
    """

    future: IntArray
    vehicle: IntArray

    def __len__(self) -> int:
        return len(self.future)

    @classmethod
    def everyone(cls, history: SceneHistory) -> VehicleIndex:
        """Return all vehicles of all futures, future by future."""
        future, vehicle = np.indices(history.now.shape).reshape(2, -1)
        return cls(future=future, vehicle=vehicle)

    def __getitem__(self, key: Any) -> VehicleIndex:
        return VehicleIndex(future=self.future[key], vehicle=self.vehicle[key])


@dataclass(frozen=True, kw_only=True, eq=False)
class Plan(States):
    """Intended future states of n vehicles, (n, H >= 30); column 0 is the next step (0.1 s ahead).

    Attributes:
        fallback: (n,) True where the path-following driver planned, because the model had no usable plan;
            None if that cannot happen.
        reasons: (n,) phrase for each fallback, empty for the model's own plan; () if unknown.

    Example:
        >>> rest = np.zeros((1, 30))
        >>> scex.Plan(x=rest, y=rest, heading=rest, speed=rest).x.shape
        (1, 30)
    """

    fallback: BoolArray | None = None
    reasons: tuple[str, ...] = ()
