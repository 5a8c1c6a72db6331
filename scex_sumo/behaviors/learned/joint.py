"""Driver of `JointPredictor`: draws the next 0.5 s of all vehicles together, again and again."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.special import ndtr, ndtri

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.behaviors.base import PLAN_STEPS
from scex_sumo.behaviors.driving.paths import SeedPaths
from scex_sumo.behaviors.driving.projection import expected_way, foot_points
from scex_sumo.behaviors.learned.architecture import TOKEN_STEPS
from scex_sumo.behaviors.learned.decoding import plan_along
from scex_sumo.behaviors.learned.driver import LearnedDriver, drawn, rounded
from scex_sumo.behaviors.learned.networks import Tokens
from scex_sumo.behaviors.learned.path_inputs import PATH_COLUMNS, PathInputs
from scex_sumo.behaviors.learned.profiles import JointPredictorProfile, Profile
from scex_sumo.behaviors.models.likely_observations import path_weights
from scex_sumo.behaviors.models.population import population, uniforms
from scex_sumo.geometry.rectangles import seen_from
from scex_sumo.road import Road
from scex_sumo.scene import STEP_S, Plan, SceneHistory, SeedScene, States, VehicleIndex

SAFE_MPS2 = 9.0  # braking with which a vehicle can still stop behind its leader, which brakes as hard
STANDING_GAP_M = 0.3  # then
NEAR_M = 25.0  # between vehicles that can get in each other's way
CLOSING_S = 0.4  # before which a vehicle that moves sideways counts as ahead
FALLS_BACK_MPS2 = 3.0  # behind one that is beside it and comes into its way
TOKEN_S = TOKEN_STEPS * STEP_S
SPEED, LEADER, GAP, LEADER_SPEED = (
    PATH_COLUMNS.index(name) for name in ("speed", "leader", "leader_gap", "leader_speed")
)
AGREEMENT = 0.9  # correlation of a vehicle's draw with that of its leader, if the gap is below:
FOLLOWS_M = 20.0
QUEUE = 4  # vehicles through which a draw is passed on
TINY = 1e-12  # keeps a motion to draw where the network holds all safe ones impossible
FIRST_SALT = 64  # of the draws of the first 0.5 s


class JointDriver(LearnedDriver):
    """A network that rolls out all vehicles of each child in steps of 0.5 s.

    It was trained on vehicles off the map, too, which keep to a straight line.
    """

    clear = leaves_map = True

    def __init__(self, kind: str, file: Path, profile: Profile) -> None:
        super().__init__(kind, file, profile, attention=1.0, free=False)

    def _drive(
        self, history: SceneHistory, road: Road, who: VehicleIndex, paths: SeedPaths, row: IntArray
    ) -> tuple[Plan, BoolArray]:
        """Roll out all vehicles of the children of `who`; other models' vehicles are predicted, too."""
        children, child = np.unique(who.child, return_inverse=True)
        vehicles = history.scene.vehicles
        here = replace(
            history,
            states=history.states[children],
            children=history.children[children],
            route_draw=history.route_draw[children],
        )
        everyone = VehicleIndex(
            child=np.repeat(np.arange(len(children)), vehicles),
            vehicle=np.tile(np.arange(vehicles), len(children)),
        )
        _, rows = self._paths(here, road, everyone)
        rolled, finite = self._roll(here, road, everyone, paths, rows)
        mine = child * vehicles + who.vehicle
        chosen = finite[mine]
        made = rolled[mine[chosen]]
        return Plan(**vars(made)), chosen

    def path_prior(self, scene: SeedScene, paths: SeedPaths) -> FloatArray:
        """Return (P,) log probabilities of `LikelyDriver`: pose, speed and shape tell more at a new place."""
        weight = path_weights(scene, paths, population())
        share = weight / np.repeat(np.add.reduceat(weight, paths.first), paths.count)
        return rounded(np.log(np.maximum(share, TINY)))

    def _roll(
        self, history: SceneHistory, road: Road, who: VehicleIndex, paths: SeedPaths, row: IntArray
    ) -> tuple[States, BoolArray]:
        children, vehicles, _ = history.states.shape
        finite, parts = np.ones(len(who), dtype=np.bool_), []
        for _ in range(PLAN_STEPS // TOKEN_STEPS):
            inputs, tokens = self.predict(history, road, who, paths, row)
            acceleration, sideways = self._chosen(history, who, tokens, inputs)
            finite &= np.isfinite(acceleration) & np.isfinite(sideways)
            acceleration[~finite], sideways[~finite] = 0.0, 0.0
            now = history.now[who.child, who.vehicle]
            _, offset, _ = foot_points(paths, row, now.x, now.y, expected_way(history, who))
            later = STEP_S * np.arange(1, TOKEN_STEPS + 1)
            made = plan_along(
                history,
                who,
                paths,
                row,
                np.repeat(acceleration[:, None], TOKEN_STEPS, axis=1),
                offset[:, None] + sideways[:, None] * later,
                road=road,
                clear=self.clear,
            )
            parts.append(made)
            states = States.concatenate(
                [history.states[:, :, TOKEN_STEPS:], made.map(lambda a: a.reshape(children, vehicles, -1))], 2
            )
            history = replace(history, states=states, step=history.step + TOKEN_STEPS)
        return States.concatenate(parts, 1), finite

    def _chosen(
        self, history: SceneHistory, who: VehicleIndex, tokens: Tokens, inputs: PathInputs
    ) -> tuple[FloatArray, FloatArray]:
        """Return (n,) accelerations, m/s², and (n,) sideways speeds, m/s, of the next 0.5 s.

        Accelerations are drawn among those after which a vehicle can stop behind its leader, which does what
        was drawn for it.
        """
        logits = rounded(tokens.logits)
        assert isinstance(self.profile, JointPredictorProfile)
        temperature = self.profile.temperature if self.profile.mode == "draw" else 1.0
        weight = np.exp((logits - logits.max(1, keepdims=True)) / temperature) + TINY
        weight = weight.reshape(len(who), len(tokens.acceleration), len(tokens.sideways))
        along = weight.sum(2)
        salt = FIRST_SALT + history.step // TOKEN_STEPS  # so a plan and the next one draw the same
        draw = _with_leaders(uniforms(history.route_draw[who.child, who.vehicle], 2, salt), inputs)
        ahead = _ahead(history, inputs)
        best = self.profile.mode == "best"
        most = np.full(len(who), np.inf)
        for _ in range(history.scene.vehicles + 1):  # a queue passes one bound on in each round
            beyond = tokens.acceleration > np.maximum(most, tokens.acceleration[0])[:, None]
            share = np.where(beyond, 0.0, along)
            share /= share.sum(1, keepdims=True)
            a = drawn(np.cumsum(share, axis=1), draw[:, 0])
            acceleration = rounded(share @ tokens.acceleration) if best else tokens.acceleration[a]
            acceleration = np.minimum(acceleration, np.maximum(most, -SAFE_MPS2))
            less = ahead.bound(inputs.features[:, SPEED], acceleration)
            if (less >= most).all():
                break
            most = np.minimum(most, less)
        if best:
            aside = np.where(beyond[:, :, None], 0.0, weight).sum(1)
            return acceleration, rounded(aside / aside.sum(1, keepdims=True) @ tokens.sideways)
        part = weight[np.arange(len(who)), a]
        s = drawn(np.cumsum(part / part.sum(1, keepdims=True), axis=1), draw[:, 1])
        return acceleration, tokens.sideways[s]


def _with_leaders(draw: FloatArray, inputs: PathInputs) -> FloatArray:
    """Return (n, 2) draws of which the first, of the acceleration, is near that of the leader (a copula)."""
    own, near = ndtri(draw[:, 0]), (inputs.leader >= 0) & (inputs.features[:, GAP] < FOLLOWS_M)
    normal = own
    for _ in range(QUEUE):
        normal = np.where(near, AGREEMENT * normal[inputs.leader] + np.sqrt(1 - AGREEMENT**2) * own, own)
    return np.column_stack([ndtr(normal), draw[:, 1]])


@dataclass(frozen=True, kw_only=True, eq=False)
class _Pairs:
    """Vehicles that must be able to stop behind another, (k,) each."""

    follower: IntArray
    leader: IntArray  # -1 for an obstacle, which keeps its speed
    gap: FloatArray  # m; where it is negative, the follower falls back
    speed: FloatArray  # of the leader along the follower's way, m/s

    def bound(self, speed: FloatArray, acceleration: FloatArray) -> FloatArray:
        """Return (n,) accelerations up to which vehicles can stop if leaders accelerate as given, m/s²."""
        own, change = speed[self.follower], TOKEN_S * np.where(self.leader < 0, 0, acceleration[self.leader])
        later = np.maximum(self.speed + change, 0.0)
        room = self.gap - STANDING_GAP_M + (self.speed + later - own) * TOKEN_S / 2
        square = (SAFE_MPS2 * TOKEN_S / 2) ** 2 + later**2 + 2 * SAFE_MPS2 * room
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
    child, i, j = np.nonzero((dx < NEAR_M) & (dy < NEAR_M))
    x, y, cos, sin, speed = seen_from(now[child, i], now[child, j]).T
    clear = x - (length[i] + np.abs(cos) * length[j] + np.abs(sin) * width[j]) / 2
    beside = np.abs(y) - (width[i] + np.abs(cos) * width[j] + np.abs(sin) * length[j]) / 2
    closing = -np.sign(y) * sin * speed
    comes = (x > 0) & (cos > 0.5) & (np.maximum(clear, beside) > 0) & (beside < CLOSING_S * closing)
    child, i, j = child[comes], i[comes], j[comes]
    first = child * scene.vehicles
    return _Pairs(
        follower=np.append(k, first + i),
        leader=np.append(inputs.leader[k], first + j),
        gap=np.append(gap[k], clear[comes]),
        speed=np.append(inputs.features[k, LEADER_SPEED], (speed * cos)[comes]),
    )
