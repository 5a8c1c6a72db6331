"""Driver of the learned models: chooses paths and modes, runs the network, drives."""

from __future__ import annotations

import pickle
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import ThreadpoolController

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray, distinct
from scex_sumo.base.cache import cached_bytes
from scex_sumo.base.errors import InputError
from scex_sumo.base.files import sha256_of
from scex_sumo.base.owned import owner_cache
from scex_sumo.behaviors.driving.motion import Intent, driven
from scex_sumo.behaviors.driving.paths import PathChoice, SeedPaths, chosen_paths
from scex_sumo.graphs.graph import scene_graph
from scex_sumo.humans.lines.nearest_path import follow_path
from scex_sumo.learned.decoding import intent_along, plan_freely, way_of
from scex_sumo.learned.inputs.path_inputs import PATH_COLUMNS, STANDING_MPS, PathInputs, path_inputs
from scex_sumo.learned.inputs.raster import raster_of
from scex_sumo.learned.network.architecture import FEATURES, STRIDE
from scex_sumo.learned.network.image_encoder import MapImage
from scex_sumo.learned.network.layers import exact
from scex_sumo.learned.network.networks import KINDS, GraphImageNet, Modes, Net
from scex_sumo.learned.network.weights import load_weights
from scex_sumo.learned.profiles import Profile
from scex_sumo.road import Road
from scex_sumo.scene import Plan, SceneHistory, SeedScene, States, VehicleIndex

OUTPUT_GRID = 2.0**-10  # m/s² and m: rounds away effects of the order of sums, see `layers`
DRAW_DIGITS = 2.0**20  # modes are drawn with digits of `route_draw` that paths do not use
STOPPING_MPS2 = -1.0
START_M, START_LIKELY = 1.0, 0.5  # a standing vehicle starts if this way in 3 s has this probability
WAITS_STEPS = 30  # during which it starts only behind a moving leader
SPEED, LEADER, LEADER_SPEED = (PATH_COLUMNS.index(name) for name in ("speed", "leader", "leader_speed"))
OFF_MAP = "was not on a mapped lane in the seed scene"
NOT_FINITE = "the network gave no finite plan"


@cache
def _algebra() -> ThreadpoolController:
    return ThreadpoolController().select(user_api="blas")


@owner_cache
def image_of(road: Road, net: GraphImageNet, kept_as: str) -> MapImage:
    """Return a map's image features; with a hash of the weights they stay in the user's cache."""
    raster = raster_of(road)
    if not kept_as:
        return MapImage.of(raster, net.image.features_of(raster))

    def make() -> bytes:
        return net.image.features_of(raster).astype(np.float32).tobytes()  # exact, on their grid

    made_of = pickle.dumps((kept_as, road))
    features = np.frombuffer(cached_bytes("images", made_of, make), np.float32).astype(np.float64)
    return MapImage.of(raster, features.reshape(FEATURES, -(-raster.values.shape[1] // STRIDE), -1))


@lru_cache(maxsize=4)
def loaded(file: Path, kind: str, sha256: str) -> tuple[Net, dict[str, Any]]:
    """Load the network of a file, made exact (see `layers`), and its meta data."""
    weights = load_weights(file, kind)
    if weights.meta["sha256"] != sha256:
        raise InputError(f"{file}: has changed since the run began; run again")
    state, share = exact(weights.state)
    if not share < 1:
        raise InputError(f"{file}: weights are {share:.3g} times too large for exact sums; train again")
    return KINDS[kind](state, weights.sizes), weights.meta


@dataclass(frozen=True, eq=False)
class _Choice:
    likeliest: IntArray  # (V,) row of the most probable path
    paths: FloatArray  # (V, K) cumulative probability of the paths, 1 after the last one
    modes: FloatArray  # (P, M) cumulative probability of the modes along each path


class LearnedDriver:
    """A network that plans for all vehicles of all futures at once.

    Path and mode of a vehicle are chosen in the seed scene.

    Attributes:
        keeps: whether image features of maps stay in the user's cache.
        leaves_map: whether it drives vehicles that are off the map, too.
        clear: whether it steers away from vehicles beside it.
    """

    keeps = False
    leaves_map = False
    clear = False

    def __init__(self, kind: str, file: Path, profile: Profile, *, attention: float, free: bool) -> None:
        self.kind, self.file, self.profile, self.attention, self.free = kind, file, profile, attention, free
        self.sha256 = sha256_of(file) if file.is_file() else ""
        if free and not self._net.sizes.free:
            raise InputError(f"{file}: trained without the head for free trajectories; use head=bounded")

    @property
    def _net(self) -> Net:
        return loaded(self.file, self.kind, self.sha256)[0]

    @property
    def meta(self) -> dict[str, Any]:
        """Meta data of the weights."""
        return loaded(self.file, self.kind, self.sha256)[1]

    def plan(
        self, history: SceneHistory, road: Road, vehicles: VehicleIndex, rng: Sequence[np.random.Generator]
    ) -> Plan:
        """Plan 3 s; see `BatchBehavior.plan`."""
        paths, row = self._paths(history, road, vehicles)
        reasons = np.where(self._drives(paths, vehicles), "", OFF_MAP)
        usable = np.flatnonzero(reasons == "")
        parts: list[tuple[IntArray, Plan]] = []
        if len(usable):
            plan, finite = self._drive(history, road, vehicles[usable], paths, row[usable])
            reasons[usable[~finite]] = NOT_FINITE
            parts.append((usable[finite], plan))
        rest = np.flatnonzero(reasons != "")
        if len(rest) or not parts:
            parts.append((rest, follow_path(history, road, vehicles[rest])))
        return _merged(parts, reasons)

    def intend(self, history: SceneHistory, road: Road, vehicles: VehicleIndex) -> Intent | None:
        """Return the drive of these vehicles along their paths; None if some need another plan."""
        paths, row = self._paths(history, road, vehicles)
        if self.free or not self._drives(paths, vehicles).all():
            return None
        intent, finite = self._intend(history, road, vehicles, paths, row)
        return intent if finite.all() else None

    def _drives(self, paths: SeedPaths, vehicles: VehicleIndex) -> BoolArray:
        return np.asarray(paths.on_road[vehicles.vehicle] | self.leaves_map)

    def predict(
        self, history: SceneHistory, road: Road, vehicles: VehicleIndex, paths: SeedPaths, row: IntArray
    ) -> tuple[PathInputs, Any]:
        """Run the network for n pairs of a vehicle and a path; return its inputs, and `Modes` or `Tokens`."""
        graph = scene_graph(history, road, radius=self.profile.radius)
        inputs = path_inputs(history, road, vehicles, paths, row, radius=self.profile.radius)
        net = self._net
        # Products this small gain nothing from threads, and workers share the cores.
        with _algebra().limit(limits=1):
            if not isinstance(net, GraphImageNet):
                return inputs, net(graph, inputs)
            now = history.now[vehicles.future, vehicles.vehicle]
            pose = np.stack([now.x, now.y, now.heading], 1)
            first, place = distinct(pose)  # many futures have a vehicle at the same place
            image = image_of(road, net, self.sha256 if self.keeps else "")
            return inputs, net(graph, inputs, image, pose[first], place, self.attention, free=self.free)

    def _drive(
        self, history: SceneHistory, road: Road, vehicles: VehicleIndex, paths: SeedPaths, row: IntArray
    ) -> tuple[Plan, BoolArray]:
        """Plan for those of n vehicles with finite outputs; return (n,) which these are, too."""
        if self.free:
            _, modes = self.predict(history, road, vehicles, paths, row)
            free = rounded(
                modes.free[np.arange(len(vehicles)), self._modes(history, road, vehicles, row, modes)]
            )
            finite = _finite(free)
            return plan_freely(history, vehicles[finite], free[finite]), finite
        intent, finite = self._intend(history, road, vehicles, paths, row)
        return driven(history, [intent])[0], finite

    def _intend(
        self, history: SceneHistory, road: Road, vehicles: VehicleIndex, paths: SeedPaths, row: IntArray
    ) -> tuple[Intent, BoolArray]:
        """Return the drive of those of n vehicles with finite outputs, and (n,) which these are."""
        inputs, modes = self.predict(history, road, vehicles, paths, row)
        chosen = (np.arange(len(vehicles)), self._modes(history, road, vehicles, row, modes))
        acceleration, offset = rounded(modes.acceleration[chosen]), rounded(modes.offset[chosen])
        if self.profile.mode == "best":
            stays = _stays(inputs, modes, waits=history.step < WAITS_STEPS)
            acceleration = np.where(stays[:, None], STOPPING_MPS2, acceleration)
        finite = _finite(acceleration) & _finite(offset)
        wanted = (acceleration[finite], offset[finite])
        some = vehicles[finite], paths, row[finite]
        return intent_along(history, *some, *wanted, road=road, clear=self.clear), finite

    def path_prior(self, scene: SeedScene, paths: SeedPaths) -> FloatArray | float:
        """Return (P,) numbers to add to the network's logits of paths."""
        return 0.0

    def _paths(self, history: SceneHistory, road: Road, vehicles: VehicleIndex) -> tuple[SeedPaths, IntArray]:
        paths, row = chosen_paths(history, road, vehicles, _plain(self.profile.path))
        if self.profile.path == "likeliest":
            choice = choice_of(history.scene, self, road)
            row = choice.likeliest[vehicles.vehicle]
            if self.profile.mode == "draw":
                draw = history.route_draw[vehicles.future, vehicles.vehicle]
                row = paths.first[vehicles.vehicle] + drawn(choice.paths[vehicles.vehicle], draw)
        return paths, row

    def _modes(
        self, history: SceneHistory, road: Road, vehicles: VehicleIndex, row: IntArray, modes: Modes
    ) -> IntArray:
        if self.profile.mode == "draw":
            upper = choice_of(history.scene, self, road).modes[row]
            draw = history.route_draw[vehicles.future, vehicles.vehicle] * DRAW_DIGITS % 1.0
            return drawn(upper, draw)
        if self.meta.get("best", "expected") == "likeliest":
            return np.asarray(rounded(modes.logits).argmax(1))
        return np.zeros(len(vehicles), dtype=np.int64)


@owner_cache
def choice_of(scene: SeedScene, driver: LearnedDriver, road: Road) -> _Choice:
    """Run the network in the seed scene."""
    history = SceneHistory.of_scene(scene)
    everyone = VehicleIndex(future=np.zeros(scene.vehicles, np.int64), vehicle=np.arange(scene.vehicles))
    paths, _ = chosen_paths(history, road, everyone, _plain(driver.profile.path))
    vehicle = np.repeat(np.arange(scene.vehicles), paths.count)
    pairs = VehicleIndex(future=np.zeros_like(vehicle), vehicle=vehicle)
    _, modes = driver.predict(history, road, pairs, paths, np.arange(len(vehicle)))
    logit = np.nan_to_num(rounded(modes.path_logit), nan=-np.inf) + driver.path_prior(scene, paths)
    ends = np.cumsum(paths.count)
    best = [int(f + np.argmax(logit[f:e])) for f, e in zip(paths.first, ends, strict=True)]
    weight = np.exp(rounded(modes.logits) - rounded(modes.logits).max(1, keepdims=True))
    upper = np.cumsum(weight, 1) / weight.sum(1, keepdims=True)
    return _Choice(np.array(best, dtype=np.int64), _cumulated(logit, paths), upper)


def _cumulated(logit: FloatArray, paths: SeedPaths) -> FloatArray:
    upper = np.ones((len(paths.count), int(paths.count.max(initial=1))))
    for v, (first, count) in enumerate(zip(paths.first, paths.count, strict=True)):
        part = logit[first : first + count]
        weight = np.exp(part - part.max()) if np.isfinite(part).any() else np.ones(count)
        upper[v, : count - 1] = (np.cumsum(weight) / weight.sum())[:-1]
    return upper


def _stays(inputs: PathInputs, modes: Modes, *, waits: bool) -> BoolArray:
    """Return (n,) whether a vehicle stands and does not start.

    The expected mode starts too early: the network does not see what the head of a queue waits for.
    """
    speed = inputs.features[:, SPEED]
    stands = speed < STANDING_MPS
    if not stands.any():
        return stands
    weight = np.exp(rounded(modes.logits) - rounded(modes.logits).max(1, keepdims=True))
    count = modes.acceleration.shape[1]
    travelled_m = [way_of(speed, rounded(modes.acceleration[:, k]))[:, -1] for k in range(count)]
    starts = np.sum(weight * (np.stack(travelled_m, 1) > START_M), 1) / weight.sum(1)
    stays = rounded(starts) < START_LIKELY
    moving_leader = (inputs.features[:, LEADER] > 0) & (inputs.features[:, LEADER_SPEED] > STANDING_MPS)
    return np.asarray(stands & (stays | (waits & ~moving_leader)))


def rounded(values: FloatArray) -> FloatArray:
    """Round outputs of a network to `OUTPUT_GRID`."""
    on_grid: FloatArray = np.round(values * (1 / OUTPUT_GRID)) * OUTPUT_GRID
    return on_grid


def drawn(upper: FloatArray, draw: FloatArray) -> IntArray:
    """Return (n,) choices from (n, K) cumulative probabilities and (n,) draws in [0, 1)."""
    return np.asarray((draw[:, None] >= upper[:, :-1]).sum(1))


def _plain(path: PathChoice | Literal["likeliest"]) -> PathChoice:
    return "straight" if path == "likeliest" else path


def _finite(values: FloatArray) -> BoolArray:
    """Return (n,) whether all of a vehicle's outputs are finite."""
    return np.asarray(np.isfinite(values.reshape(len(values), -1)).all(axis=1))


def _merged(parts: list[tuple[IntArray, Plan]], reasons: NDArray[np.str_]) -> Plan:
    whole = States.empty((len(reasons), parts[0][1].shape[1]))
    for index, plan in parts:
        whole.assign(index, plan)
    return Plan(**vars(whole), fallback=reasons != "", reasons=tuple(reasons.tolist()))
