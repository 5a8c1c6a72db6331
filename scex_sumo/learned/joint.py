"""Driver of `joint_predictor`: draws the next 0.5 s of all vehicles together, again and again."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.special import ndtr, ndtri

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray, Rows
from scex_sumo.base.draws import uniforms
from scex_sumo.base.owned import owner_cache
from scex_sumo.behaviors.base import PLAN_STEPS
from scex_sumo.behaviors.driving.motion import driven
from scex_sumo.behaviors.driving.paths import BEHIND_M, SeedPaths, expected_way
from scex_sumo.geometry.rectangles import Rectangles, rectangle_distance, seen_from
from scex_sumo.humans.observed.observations import path_weights
from scex_sumo.humans.observed.seed_state import estimated_history
from scex_sumo.humans.parameters import human_parameters
from scex_sumo.learned.decoding import intent_along
from scex_sumo.learned.driver import LEADER, LEADER_SPEED, SPEED, LearnedDriver, drawn, rounded
from scex_sumo.learned.inputs.path_inputs import PATH_COLUMNS, PathInputs
from scex_sumo.learned.network.architecture import TOKEN_STEPS
from scex_sumo.learned.network.networks import Tokens
from scex_sumo.learned.profiles import JointPredictorProfile
from scex_sumo.road import Road
from scex_sumo.roads.conflicts import runs
from scex_sumo.scene import STEP_S, Plan, SceneHistory, SeedScene, States, VehicleIndex

SAFE_MPS2 = 9.0  # braking with which a vehicle can still stop behind its leader, which brakes as hard
STANDING_GAP_M = 0.3  # then
NEAR_M = 25.0  # between vehicles that can get in each other's way
CLOSING_S = 0.4  # before which a vehicle that moves sideways counts as ahead
FALLS_BACK_MPS2 = 3.0  # behind one that is beside it and comes into its way
LOOK_M, SPACING_M = 100.0, 1.0  # along paths for crossings
CLEARANCE_M = 2.2  # between paths that are in each other's way
SLOW_MPS, STARTS_MPS2 = 0.5, 2.0  # a slower vehicle leaves the others first; with it a waiting one starts
CLEAR_S = 0.5  # between two vehicles at a crossing
APART_M, TOUCH_M = 0.1, 1.0  # between boxes at the end of a motion; between those that are compared
TOKEN_S = TOKEN_STEPS * STEP_S
GAP = PATH_COLUMNS.index("leader_gap")
AGREEMENT = 0.9  # correlation of a vehicle's draw with that of its leader, if the gap is below:
FOLLOWS_M = 20.0
QUEUE = 4  # vehicles through which a draw is passed on
TINY = 1e-12  # keeps a motion to draw where the network holds all safe ones impossible
FIRST_SALT, REDRAW_SALT = 64, 4096  # of the draws of the first 0.5 s; between those of a future drawn again
REDRAWS = 3  # of a future in which boxes touch


class JointDriver(LearnedDriver):
    """A network that rolls out all vehicles of each future in steps of 0.5 s.

    It was trained on vehicles off the map, too. Vehicles start with estimated headings and speeds. Futures in
    which boxes touch are drawn again, up to `REDRAWS` times.
    """

    clear = leaves_map = True
    profile: JointPredictorProfile

    def intend(self, history: SceneHistory, road: Road, vehicles: VehicleIndex) -> None:
        """Vehicles move together: there are only plans."""

    def _drive(
        self, history: SceneHistory, road: Road, vehicles: VehicleIndex, paths: SeedPaths, path: IntArray
    ) -> tuple[Plan, BoolArray]:
        """Roll out all vehicles of the futures of `vehicles`; other models' vehicles are predicted, too."""
        futures, future = np.unique(vehicles.future, return_inverse=True)
        count, batch = history.scene.vehicles, history.part(futures)
        _, chosen = self._paths(batch, road, VehicleIndex.everyone(batch))
        rolled, finite = self._roll(batch, road, paths, chosen)
        for attempt in range(1, 1 + (REDRAWS if self.profile.mode == "draw" else 0)):
            again = np.flatnonzero(_touch(batch, rolled))
            if not len(again):
                break
            k = (again[:, None] * count + np.arange(count)).ravel()
            redrawn, finite[k] = self._roll(batch.part(again), road, paths, chosen[k], attempt)
            rolled.assign(k, redrawn)
        mine = future * count + vehicles.vehicle
        return Plan(**vars(rolled[mine[finite[mine]]])), finite[mine]

    def path_prior(self, scene: SeedScene, paths: SeedPaths) -> FloatArray:
        """Return (P,) log probabilities of `LikelyDriver`, from pose, speed and shape, times `prior`."""
        weight = path_weights(scene, paths, human_parameters())
        share = weight / np.repeat(np.add.reduceat(weight, paths.first), paths.count)
        return rounded(self.profile.prior * np.log(np.maximum(share, TINY)))

    def _roll(
        self, history: SceneHistory, road: Road, paths: SeedPaths, path: IntArray, attempt: int = 0
    ) -> tuple[States, BoolArray]:
        """Return states (F * V, H) of all vehicles on their paths, and which are finite."""
        shape, vehicles = (*history.now.shape, -1), VehicleIndex.everyone(history)
        finite, parts = np.ones(len(vehicles), dtype=np.bool_), []
        for _ in range(PLAN_STEPS // TOKEN_STEPS):
            inputs, tokens = self.predict(history, road, vehicles, paths, path)
            now = history.now[vehicles.future, vehicles.vehicle]
            arc_length, offset, _ = paths.foot_points(path, now.x, now.y, expected_way(history, vehicles))
            ahead = _Pairs.join([_ahead(history, inputs), _crossing(history, paths, path, arc_length)])
            # so a plan and the next one draw the same
            salt = FIRST_SALT + REDRAW_SALT * attempt + history.step // TOKEN_STEPS
            draw = uniforms(history.route_draw[vehicles.future, vehicles.vehicle], 2, salt)
            acceleration, sideways = self._chosen(history, draw, tokens, inputs, ahead)
            finite &= np.isfinite(acceleration) & np.isfinite(sideways)
            acceleration[~finite], sideways[~finite] = 0.0, 0.0
            motion = np.stack([acceleration, offset, sideways])
            plan = self._driven(history, road, vehicles, paths, path, motion)
            pairs = _near(history, plan)
            for both in (False, True):
                k = _yielding(history, plan, pairs, both=both)
                if not len(k):
                    break
                motion[0, k], motion[2, k] = -SAFE_MPS2, 0.0
                plan.assign(k, self._driven(history, road, vehicles[k], paths, path[k], motion[:, k]))
            parts.append(plan)
            states = States.concatenate(
                [history.states[:, :, TOKEN_STEPS:], plan.map(lambda a: a.reshape(shape))], 2
            )
            history = replace(history, states=states, step=history.step + TOKEN_STEPS)
        return States.concatenate(parts, 1), finite

    def _driven(
        self,
        history: SceneHistory,
        road: Road,
        vehicles: VehicleIndex,
        paths: SeedPaths,
        path: IntArray,
        motion: FloatArray,
    ) -> Plan:
        """Drive n vehicles for 0.5 s; motion (3, n): acceleration, m/s², offset, m, sideways speed, m/s."""
        if history.step == 0:
            heading = estimated_history(history, road).states.heading
            history = replace(history, states=replace(history.states, heading=heading))
        acceleration, offset, sideways = motion[:, :, None]
        wanted = offset + sideways * (STEP_S * np.arange(1, TOKEN_STEPS + 1))
        steady = np.repeat(acceleration, TOKEN_STEPS, axis=1)
        intent = intent_along(history, vehicles, paths, path, steady, wanted, road, clear=self.clear)
        return driven(history, [intent], TOKEN_STEPS)[0]

    def _chosen(
        self, history: SceneHistory, draw: FloatArray, tokens: Tokens, inputs: PathInputs, ahead: _Pairs
    ) -> tuple[FloatArray, FloatArray]:
        """Return (n,) accelerations, m/s², and (n,) sideways speeds, m/s, of the next 0.5 s.

        Accelerations are drawn among those after which a vehicle can stop behind its leader, which does what
        was drawn for it, and before a crossing at which another one comes first.
        """
        logits = rounded(tokens.logits)
        temperature = self.profile.temperature if self.profile.mode == "draw" else 1.0
        weight = np.exp((logits - logits.max(1, keepdims=True)) / temperature) + TINY
        weight = weight.reshape(len(draw), len(tokens.acceleration), len(tokens.sideways))
        along = weight.sum(2)
        draw = _with_leaders(draw, inputs)
        best = self.profile.mode == "best"
        most = np.full(len(draw), np.inf)
        for _ in range(history.scene.vehicles + 1):  # a queue passes one bound on in each round
            beyond = tokens.acceleration > np.maximum(most, tokens.acceleration[0])[:, None]
            share = np.where(beyond, 0.0, along)
            share /= share.sum(1, keepdims=True)
            a = drawn(np.cumsum(share, axis=1), draw[:, 0])
            acceleration = rounded(share @ tokens.acceleration) if best else tokens.acceleration[a]
            acceleration = np.minimum(acceleration, np.maximum(most, -SAFE_MPS2))
            bound = ahead.bound(inputs.features[:, SPEED], acceleration)
            if (bound >= most).all():
                break
            most = np.minimum(most, bound)
        if best:
            aside = np.where(beyond[:, :, None], 0.0, weight).sum(1)
            return acceleration, rounded(aside / aside.sum(1, keepdims=True) @ tokens.sideways)
        sideways_weight = weight[np.arange(len(draw)), a]
        s = drawn(np.cumsum(sideways_weight / sideways_weight.sum(1, keepdims=True), axis=1), draw[:, 1])
        return acceleration, tokens.sideways[s]


def _with_leaders(draw: FloatArray, inputs: PathInputs) -> FloatArray:
    """Return (n, 2) draws of which the first, of the acceleration, is near that of the leader (a copula)."""
    own, near = ndtri(draw[:, 0]), (inputs.leader >= 0) & (inputs.features[:, GAP] < FOLLOWS_M)
    normal = own
    for _ in range(QUEUE):
        normal = np.where(near, AGREEMENT * normal[inputs.leader] + np.sqrt(1 - AGREEMENT**2) * own, own)
    return np.column_stack([ndtr(normal), draw[:, 1]])


@dataclass(frozen=True, kw_only=True, eq=False)
class _Pairs(Rows):
    """Vehicles that must be able to stop behind another, (k,) each."""

    follower: IntArray
    leader: IntArray  # -1 for an obstacle, which keeps its speed
    gap: FloatArray  # m; where it is negative, the follower falls back
    speed: FloatArray  # of the leader along the follower's way, m/s

    def bound(self, speed: FloatArray, acceleration: FloatArray) -> FloatArray:
        """Return (n,) accelerations up to which vehicles can stop if leaders accelerate as given, m/s²."""
        own, change = speed[self.follower], TOKEN_S * np.where(self.leader < 0, 0, acceleration[self.leader])
        speed_after = np.maximum(self.speed + change, 0.0)
        room = self.gap - STANDING_GAP_M + (self.speed + speed_after - own) * TOKEN_S / 2
        square = (SAFE_MPS2 * TOKEN_S / 2) ** 2 + speed_after**2 + 2 * SAFE_MPS2 * room
        safe = np.sqrt(np.maximum(square, 0.0)) - SAFE_MPS2 * TOKEN_S / 2
        most = np.full(len(speed), np.inf)
        np.minimum.at(most, self.follower, np.where(self.gap > 0, (safe - own) / TOKEN_S, -FALLS_BACK_MPS2))
        return most


def _ahead(history: SceneHistory, inputs: PathInputs) -> _Pairs:
    """Return leaders on the path, and vehicles that soon come before another's front."""
    scene = history.scene
    gap = inputs.features[:, GAP]
    k = np.flatnonzero((inputs.features[:, LEADER] > 0) & (gap > 0))
    now, length, width = history.now, scene.length, scene.width
    dx, dy = (np.abs(a[:, None, :] - a[:, :, None]) for a in (now.x, now.y))
    future, i, j = np.nonzero((dx < NEAR_M) & (dy < NEAR_M))
    x, y, cos, sin, speed = seen_from(now[future, i], now[future, j]).T
    clear = x - (length[i] + np.abs(cos) * length[j] + np.abs(sin) * width[j]) / 2
    beside = np.abs(y) - (width[i] + np.abs(cos) * width[j] + np.abs(sin) * length[j]) / 2
    closing = -np.sign(y) * sin * speed
    comes = (x > 0) & (cos > 0.5) & (np.maximum(clear, beside) > 0) & (beside < CLOSING_S * closing)
    future, i, j = future[comes], i[comes], j[comes]
    first = future * scene.vehicles
    return _Pairs(
        follower=np.append(k, first + i),
        leader=np.append(inputs.leader[k], first + j),
        gap=np.append(gap[k], clear[comes]),
        speed=np.append(inputs.features[k, LEADER_SPEED], (speed * cos)[comes]),
    )


def _near(history: SceneHistory, plan: Plan) -> tuple[IntArray, IntArray, IntArray]:
    """Return future and both vehicles of (k,) pairs that can touch within a motion."""
    length, shape = history.scene.length, history.now.shape
    reach = (length[:, None] + length) / 2 + TOUCH_M
    near = np.triu(np.ones(reach.shape, dtype=np.bool_), 1)
    for values in (plan.x, plan.y):
        end = values[:, -1].reshape(shape)
        near = near & (np.abs(end[:, None, :] - end[:, :, None]) < reach)
    future, i, j = np.nonzero(near)
    return future, i, j


def _touch(history: SceneHistory, states: States) -> BoolArray:
    """Return (F,) futures of states (F * V, H) in which boxes come to touch that do not now."""
    scene, (futures, vehicles, _) = history.scene, history.states.shape
    half = np.hypot(scene.length, scene.width) / 2
    reach = np.where(np.tri(vehicles, k=0), -1.0, half[:, None] + half)

    def touching(moment: States) -> BoolArray:
        apart = np.hypot(*(a[:, None, :] - a[:, :, None] for a in (moment.x, moment.y)))
        future, *pair = np.nonzero(apart < reach)
        boxes = (Rectangles.of(moment[future, v], scene.length[v], scene.width[v]) for v in pair)
        result = np.zeros(apart.shape, dtype=np.bool_)
        result[(future, *pair)] = rectangle_distance(*boxes) <= 0
        return result

    hit = np.zeros((futures, vehicles, vehicles), dtype=np.bool_)
    for k in range(1, PLAN_STEPS, 2):
        hit |= touching(states[:, k].map(lambda a: a.reshape(futures, vehicles)))
    return np.asarray((hit & ~touching(history.now)).any(axis=(1, 2)))


def _yielding(
    history: SceneHistory, plan: Plan, pairs: tuple[IntArray, IntArray, IntArray], *, both: bool
) -> IntArray:
    """Return the vehicles whose box comes too near to one further ahead; with ``both`` that one as well."""
    future, i, j = pairs
    scene, now = history.scene, history.now
    node_i, node_j = future * scene.vehicles + i, future * scene.vehicles + j

    def apart(first: States, second: States) -> FloatArray:
        own = Rectangles.of(first, scene.length[i], scene.width[i])
        return rectangle_distance(own, Rectangles.of(second, scene.length[j], scene.width[j]))

    before = apart(now[future, i], now[future, j])
    middle, end = (apart(plan[node_i, k], plan[node_j, k]) for k in (TOKEN_STEPS // 2, TOKEN_STEPS - 1))
    k = np.flatnonzero(np.minimum(middle, end) < np.minimum(before, APART_M))
    future, i, j, node_i, node_j = (a[k] for a in (future, i, j, node_i, node_j))
    ahead = seen_from(now[future, i], now[future, j])[:, 0] - seen_from(now[future, j], now[future, i])[:, 0]
    return np.unique(np.append(node_i[(ahead >= 0) | both], node_j[(ahead <= 0) | both]))


class _Conflicts(NamedTuple):
    """K pairs of paths of two vehicles that come together ahead of both."""

    vehicle: IntArray  # (K, 2)
    path: IntArray  # (K, 2)
    span: FloatArray  # (K, 2, 2) where the other path is too near, m; to infinity where they merge


@owner_cache
def _conflicts(paths: SeedPaths) -> _Conflicts:
    """Return all conflicts of a scene in both orders."""
    owner = np.repeat(np.arange(len(paths.count)), paths.count)
    s = BEHIND_M + np.arange(0.0, LOOK_M, SPACING_M)
    n = len(s)
    samples = paths.at(np.repeat(np.arange(len(owner)), n), np.tile(s, len(owner)))
    x, y = xy = samples[:2].reshape(2, -1, n)
    low, high = xy.min(axis=2) - CLEARANCE_M, xy.max(axis=2)
    meet = (owner[:, None] != owner) & (low[:, :, None] < high[:, None]).all(0)
    conflicts = []
    for a, b in np.argwhere(np.triu(meet & meet.T)):
        near = np.hypot(x[a][:, None] - x[b], y[a][:, None] - y[b]) < CLEARANCE_M
        if not near.any():
            continue
        begin, last = np.array([runs(near.any(axis=1))[0], runs(near.any(axis=0))[0]]).T
        if begin.min() > 0:
            span = np.column_stack([s[begin], np.full(2, np.inf) if last.max() == n - 1 else s[last + 1]])
            conflicts += [((a, b), span), ((b, a), span[::-1])]
    pairs = np.array([pair for pair, _ in conflicts], dtype=np.int64).reshape(-1, 2)
    return _Conflicts(owner[pairs], pairs, np.array([span for _, span in conflicts]).reshape(-1, 2, 2))


def _crossing(history: SceneHistory, paths: SeedPaths, path: IntArray, arc_length: FloatArray) -> _Pairs:
    """Return vehicles that have to wait before a crossing, and those that come first.

    One that cannot stop before the crossing any more comes first; else one that moves and gets there earlier,
    unless the other is through by then.
    """
    scene = history.scene
    table, shape = _conflicts(paths), (-1, scene.vehicles)
    chosen, arcs, speeds = path.reshape(shape), arc_length.reshape(shape), np.maximum(history.now.speed, 0.0)
    future, k = np.nonzero((chosen[:, table.vehicle] == table.path).all(axis=2))
    vehicles = table.vehicle[k]
    speed, half = speeds[future[:, None], vehicles], scene.length[vehicles] / 2
    place = arcs[future[:, None], vehicles]
    room, until_clear = table.span[k, :, 0] - place - half, table.span[k, :, 1] - place + half
    committed = speed**2 > 2 * SAFE_MPS2 * np.maximum(room, 0.0)
    arrival = np.where(speed > SLOW_MPS, np.maximum(room, 0.0) / np.maximum(speed, SLOW_MPS), np.inf)
    own = speed[:, 0]
    through = (np.sqrt(own**2 + 2 * STARTS_MPS2 * np.maximum(until_clear[:, 0], 0.0)) - own) / STARTS_MPS2
    is_later = (arrival[:, 1] < arrival[:, 0]) & (arrival[:, 1] < through + CLEAR_S)
    waits = ~committed[:, 0] & (committed[:, 1] | is_later) & (until_clear[:, 1] > 0)
    behind = room[:, 0] - room[:, 1] - 2 * half[:, 1]  # to the other one's rear where the paths have merged
    follows = np.isinf(until_clear).all(axis=1) & (room[:, 1] < 0) & (behind > 0)
    node = future[:, None] * scene.vehicles + vehicles
    return _Pairs(
        follower=node[waits, 0],
        leader=np.where(follows, node[:, 1], -1)[waits],
        gap=np.where(follows, behind, room[:, 0])[waits],
        speed=np.where(follows, speed[:, 1], 0.0)[waits],
    )
