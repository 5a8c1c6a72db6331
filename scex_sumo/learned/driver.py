"""Driver of the learned models: chooses paths and modes, runs the network, drives."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import ThreadpoolController

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray, distinct, least_of
from scex_sumo.base.errors import InputError
from scex_sumo.base.files import sha256_of
from scex_sumo.base.owned import owner_cache
from scex_sumo.behaviors.base import PLAN_STEPS, Driver, Sight
from scex_sumo.behaviors.driving.motion import Intent, driven
from scex_sumo.behaviors.driving.paths import SeedPaths, chosen_paths, upper_edges
from scex_sumo.graphs.graph import scene_graph
from scex_sumo.learned.decoding import intent_along, plan_freely, way_of
from scex_sumo.learned.inputs.path_inputs import PATH_COLUMNS, STANDING_MPS, PathInputs, path_inputs
from scex_sumo.learned.inputs.surface import raster_of
from scex_sumo.learned.network.encoders import MapImage
from scex_sumo.learned.network.layers import exact
from scex_sumo.learned.network.networks import KINDS, GraphImageNet, Modes, Net
from scex_sumo.learned.network.weights import MODELS, load_weights
from scex_sumo.learned.profiles import GraphImagePredictorProfile, GraphPredictorProfile
from scex_sumo.plug_in.fallback import follow_path
from scex_sumo.road import Road
from scex_sumo.scene import Plan, SceneHistory, SeedScene, States, VehicleIndex

SHIPPED = Path(__file__).parent / "trained"
OUTPUT_GRID = 2.0**-10  # m/s² and m: rounds away effects of the order of sums, see `layers`
DRAW_DIGITS = 2.0**20  # modes are drawn with digits of `route_draw` that paths do not use
STOPPING_MPS2 = -1.0
START_M, START_LIKELY = 1.0, 0.5  # a standing vehicle starts if this way in 3 s has this probability
LEAST_LOGIT = -1e300  # of a path for which the network gives no number
WAITS_STEPS = 30  # during which it starts only behind a moving leader
SPEED, LEADER, LEADER_SPEED = (PATH_COLUMNS.index(name) for name in ("speed", "leader", "leader_speed"))
OFF_MAP = "was not on a mapped lane in the seed scene"
NOT_FINITE = "the network gave no finite plan"


@cache
def _algebra() -> ThreadpoolController:
    return ThreadpoolController().select(user_api="blas")


@owner_cache
def image_of(road: Road, net: GraphImageNet) -> MapImage:
    """Return a map's image features."""
    raster = raster_of(road)
    return MapImage.of(raster, net.image.features_of(raster))


@lru_cache(maxsize=4)
def loaded(file: Path, kind: str, sha256: str) -> Net:
    """Load the network of a file, made exact (see `layers`)."""
    weights = load_weights(file, kind)
    if weights.meta["sha256"] != sha256:
        raise InputError(f"{file}: has changed since the run began; run again")
    state, share = exact(weights.state)
    if not share < 1:
        raise InputError(f"{file}: weights are {share:.3g} times too large for exact sums; train again")
    return KINDS[kind](state, weights.sizes)


@dataclass(frozen=True, eq=False)
class _Choice:
    likeliest: IntArray  # (V,) the most probable path
    paths: FloatArray  # (P,) `upper_edges` of the paths' shares of a draw
    modes: FloatArray  # (P, M) cumulative probability of the modes along each path


class LearnedDriver(Driver):
    """A network that plans for all vehicles of all futures at once.

    Path and mode of a vehicle are chosen in the seed scene; follows its path off the map.

    Attributes:
        leaves_map: whether the network drives vehicles that are off the map, too.
        clear: whether it steers away from vehicles beside it.
    """

    leaves_map = False
    clear = False

    def __init__(self, kind: str, profile: GraphPredictorProfile) -> None:
        given, shipped = profile.weights, SHIPPED / f"{MODELS[kind]}.safetensors"
        self.weights = Path(given).expanduser().absolute() if given else shipped
        self.kind, self.profile = kind, profile
        self.free = isinstance(profile, GraphImagePredictorProfile) and profile.head == "free"
        self.weights_sha256 = sha256_of(self.weights) if self.weights.is_file() else ""
        if not self._net.sizes.free and self.free:  # loads the weights, to report them before the run begins
            raise InputError(
                f"{self.weights}: trained without the head for free trajectories; use head=bounded"
            )

    @property
    def _net(self) -> Net:
        return loaded(self.weights, self.kind, self.weights_sha256)

    @property
    def sight(self) -> Sight | None:
        """What a plan depends on; a drawn path or mode differs between futures."""
        return None if self.profile.path == "random" or self.profile.mode == "draw" else "everyone"

    def clear_of_others(self) -> LearnedDriver:
        """See `Driver.clear_of_others`."""
        other = copy(self)
        other.clear = True
        return other

    def plan(
        self, history: SceneHistory, road: Road, vehicles: VehicleIndex, rng: Sequence[np.random.Generator]
    ) -> Plan:
        """Plan 3 s; see `BatchBehavior.plan`."""
        paths, path = self._paths(history, road, vehicles)
        reasons = np.where(self._drives(paths, vehicles), "", OFF_MAP)
        usable, states = np.flatnonzero(reasons == ""), States.empty((len(vehicles), PLAN_STEPS))
        if len(usable):
            plan, finite = self._drive(history, road, vehicles[usable], paths, path[usable])
            reasons[usable[~finite]] = NOT_FINITE
            states.assign(usable[finite], plan)
        unusable = np.flatnonzero(reasons != "")
        if len(unusable):
            states.assign(unusable, follow_path(history, road, vehicles[unusable]))
        return Plan(**vars(states), fallback=reasons != "", reasons=tuple(reasons.tolist()))

    def intend(self, history: SceneHistory, road: Road, vehicles: VehicleIndex) -> Intent | None:
        """Return the drive of these vehicles along their paths; None if some need another plan."""
        paths, path = self._paths(history, road, vehicles)
        if self.free or not self._drives(paths, vehicles).all():
            return None
        intent, finite = self._intend(history, road, vehicles, paths, path)
        return intent if finite.all() else None

    def _drives(self, paths: SeedPaths, vehicles: VehicleIndex) -> BoolArray:
        return np.asarray(paths.on_road[vehicles.vehicle] | self.leaves_map)

    def predict(
        self, history: SceneHistory, road: Road, vehicles: VehicleIndex, paths: SeedPaths, path: IntArray
    ) -> tuple[PathInputs, Any]:
        """Run the network for n pairs of a vehicle and a path; return its inputs, and `Modes` or `Tokens`."""
        graph, inputs = scene_graph(history, road), path_inputs(history, road, vehicles, paths, path)
        net, profile = self._net, self.profile
        # Products this small gain nothing from threads, and workers share the cores.
        with _algebra().limit(limits=1):
            if not isinstance(net, GraphImageNet):
                return inputs, net(graph, inputs)
            assert isinstance(profile, GraphImagePredictorProfile)
            now = history.now[vehicles.future, vehicles.vehicle]
            pose = np.stack([now.x, now.y, now.heading], 1)
            first, place = distinct(pose)  # many futures have a vehicle at the same place
            image = image_of(road, net)
            return inputs, net(graph, inputs, image, pose[first], place, profile.attention, free=self.free)

    def _drive(
        self, history: SceneHistory, road: Road, vehicles: VehicleIndex, paths: SeedPaths, path: IntArray
    ) -> tuple[Plan, BoolArray]:
        """Plan for those of n vehicles with finite outputs; return (n,) which these are, too."""
        if not self.free:
            intent, finite = self._intend(history, road, vehicles, paths, path)
            return driven(history, [intent])[0], finite
        _, modes = self.predict(history, road, vehicles, paths, path)
        mode = self._modes(history, road, vehicles, path, modes)
        free = rounded(modes.free[np.arange(len(vehicles)), mode])
        finite = _finite(free)
        return plan_freely(history, vehicles[finite], free[finite]), finite

    def _intend(
        self, history: SceneHistory, road: Road, vehicles: VehicleIndex, paths: SeedPaths, path: IntArray
    ) -> tuple[Intent, BoolArray]:
        """Return the drive of those of n vehicles with finite outputs, and (n,) which these are."""
        inputs, modes = self.predict(history, road, vehicles, paths, path)
        chosen = (np.arange(len(vehicles)), self._modes(history, road, vehicles, path, modes))
        acceleration, offset = rounded(modes.acceleration[chosen]), rounded(modes.offset[chosen])
        if self.profile.mode == "best":
            stays = _stays(inputs, modes, waits=history.step < WAITS_STEPS)
            acceleration = np.where(stays[:, None], STOPPING_MPS2, acceleration)
        finite = _finite(acceleration) & _finite(offset)
        vehicles, path, motion = vehicles[finite], path[finite], (acceleration[finite], offset[finite])
        return intent_along(history, vehicles, paths, path, *motion, road, clear=self.clear), finite

    def path_prior(self, scene: SeedScene, paths: SeedPaths) -> FloatArray | float:
        """Return (P,) numbers to add to the network's logits of paths."""
        return 0.0

    def _paths(self, history: SceneHistory, road: Road, vehicles: VehicleIndex) -> tuple[SeedPaths, IntArray]:
        setting, mine = self.profile.path, vehicles.vehicle
        paths, path = chosen_paths(history, road, vehicles, "straight" if setting == "likeliest" else setting)
        if setting != "likeliest":
            return paths, path
        choice = choice_of(history.scene, self, road)
        if self.profile.mode != "draw":
            return paths, choice.likeliest[mine]
        return paths, paths.drawn(mine, history.route_draw[vehicles.future, mine], choice.paths)

    def _modes(
        self, history: SceneHistory, road: Road, vehicles: VehicleIndex, path: IntArray, modes: Modes
    ) -> IntArray:
        if self.profile.mode == "draw":
            upper = choice_of(history.scene, self, road).modes[path]
            draw = history.route_draw[vehicles.future, vehicles.vehicle] * DRAW_DIGITS % 1.0
            return drawn(upper, draw)
        return np.zeros(len(vehicles), dtype=np.int64)


@owner_cache
def choice_of(scene: SeedScene, driver: LearnedDriver, road: Road) -> _Choice:
    """Run the network in the seed scene."""
    history = SceneHistory.of_scene(scene)
    paths, _ = chosen_paths(history, road, VehicleIndex.everyone(history), "straight")
    vehicle = np.repeat(np.arange(scene.vehicles), paths.count)
    pairs = VehicleIndex(future=np.zeros_like(vehicle), vehicle=vehicle)
    _, modes = driver.predict(history, road, pairs, paths, np.arange(len(vehicle)))
    logit = np.nan_to_num(rounded(modes.path_logit), nan=LEAST_LOGIT) + driver.path_prior(scene, paths)
    likeliest = least_of(vehicle, -logit)
    edges = upper_edges(np.exp(logit - logit[likeliest][vehicle]), paths.first, paths.count)
    weight = _weights(modes)
    return _Choice(likeliest, edges, np.cumsum(weight, 1) / weight.sum(1, keepdims=True))


def _weights(modes: Modes) -> FloatArray:
    """Return (n, M) weights of modes, 1 of the likeliest of a path."""
    logits = rounded(modes.logits)
    return np.asarray(np.exp(logits - logits.max(1, keepdims=True)))


def _stays(inputs: PathInputs, modes: Modes, *, waits: bool) -> BoolArray:
    """Return (n,) whether a vehicle stands and does not start.

    The expected mode starts too early: the network does not see what the head of a queue waits for.
    """
    speed = inputs.features[:, SPEED]
    stands = speed < STANDING_MPS
    if not stands.any():
        return stands
    weight, accelerations = _weights(modes), rounded(modes.acceleration).swapaxes(0, 1)
    travelled_m = [way_of(speed, acceleration)[:, -1] for acceleration in accelerations]
    starts = np.sum(weight * (np.stack(travelled_m, 1) > START_M), 1) / weight.sum(1)
    stays = rounded(starts) < START_LIKELY
    moving_leader = (inputs.features[:, LEADER] > 0) & (inputs.features[:, LEADER_SPEED] > STANDING_MPS)
    return np.asarray(stands & (stays | (waits & ~moving_leader)))


def rounded(values: FloatArray) -> FloatArray:
    """Round outputs of a network to `OUTPUT_GRID`."""
    return np.asarray(np.round(values * (1 / OUTPUT_GRID)) * OUTPUT_GRID)


def drawn(upper: FloatArray, draw: FloatArray) -> IntArray:
    """Return (n,) choices from (n, K) cumulative probabilities and (n,) draws in [0, 1)."""
    return np.asarray((draw[:, None] >= upper[:, :-1]).sum(1))


def _finite(values: FloatArray) -> BoolArray:
    """Return (n,) whether all of a vehicle's outputs are finite."""
    return np.asarray(np.isfinite(values.reshape(len(values), -1)).all(axis=1))
