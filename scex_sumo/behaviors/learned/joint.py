"""Driver of `JointPredictor`: draws the next 0.5 s of all vehicles together, again and again."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.behaviors.base import PLAN_STEPS
from scex_sumo.behaviors.driving.paths import SeedPaths
from scex_sumo.behaviors.driving.projection import expected_way, foot_points
from scex_sumo.behaviors.learned.architecture import TOKEN_STEPS
from scex_sumo.behaviors.learned.decoding import plan_along
from scex_sumo.behaviors.learned.driver import LearnedDriver, drawn, rounded
from scex_sumo.behaviors.learned.networks import Tokens
from scex_sumo.behaviors.learned.path_inputs import PATH_COLUMNS
from scex_sumo.behaviors.learned.profiles import JointPredictorProfile, Profile
from scex_sumo.behaviors.models.population import uniforms
from scex_sumo.road import Road
from scex_sumo.scene import STEP_S, Plan, SceneHistory, States, VehicleIndex

SAFE_MPS2 = 9.0  # braking with which a vehicle can still stop behind its leader, which brakes as hard
REACTION_S = 0.1
SPEED, LEADER, GAP, LEADER_SPEED = (
    PATH_COLUMNS.index(name) for name in ("speed", "leader", "leader_gap", "leader_speed")
)
TINY = 1e-12  # keeps a motion to draw where the network holds all safe ones impossible
FIRST_SALT = 64  # of the draws of the first 0.5 s


class JointDriver(LearnedDriver):
    """A network that rolls out all vehicles of each child in steps of 0.5 s."""

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

    def _roll(
        self, history: SceneHistory, road: Road, who: VehicleIndex, paths: SeedPaths, row: IntArray
    ) -> tuple[States, BoolArray]:
        children, vehicles, _ = history.states.shape
        off_map = ~paths.on_road[who.vehicle]
        finite, parts = np.ones(len(who), dtype=np.bool_), []
        for _ in range(PLAN_STEPS // TOKEN_STEPS):
            inputs, tokens = self.predict(history, road, who, paths, row)
            acceleration, sideways = self._chosen(history, who, tokens, _most(inputs.features))
            finite &= np.isfinite(acceleration) & np.isfinite(sideways)
            kept = off_map | ~finite
            acceleration[kept], sideways[kept] = 0.0, 0.0
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
        self, history: SceneHistory, who: VehicleIndex, tokens: Tokens, most: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return (n,) accelerations up to `most`, m/s², and (n,) sideways speeds, m/s, of the next 0.5 s."""
        logits = rounded(tokens.logits)
        assert isinstance(self.profile, JointPredictorProfile)
        temperature = self.profile.temperature if self.profile.mode == "draw" else 1.0
        weight = np.exp((logits - logits.max(1, keepdims=True)) / temperature) + TINY
        weight = weight.reshape(len(who), len(tokens.acceleration), len(tokens.sideways))
        beyond = tokens.acceleration > np.maximum(most, tokens.acceleration[0])[:, None]
        weight[beyond] = 0.0
        along = weight.sum(2)
        along = along / along.sum(1, keepdims=True)
        if self.profile.mode == "best":
            aside = weight.sum(1)
            aside = aside / aside.sum(1, keepdims=True)
            return rounded(along @ tokens.acceleration), rounded(aside @ tokens.sideways)
        salt = FIRST_SALT + history.step // TOKEN_STEPS  # so a plan and the next one draw the same
        draw = uniforms(history.route_draw[who.child, who.vehicle], 2, salt)
        a = drawn(np.cumsum(along, axis=1), draw[:, 0])
        part = weight[np.arange(len(who)), a]
        s = drawn(np.cumsum(part / part.sum(1, keepdims=True), axis=1), draw[:, 1])
        return tokens.acceleration[a], tokens.sideways[s]


def _most(features: FloatArray) -> FloatArray:
    """Return (n,) accelerations, m/s², after which vehicles can stop behind their leaders (Krauss 1998)."""
    gap, brake = features[:, GAP], SAFE_MPS2 * REACTION_S
    safe = np.sqrt(brake**2 + features[:, LEADER_SPEED] ** 2 + 2 * SAFE_MPS2 * np.maximum(gap, 0.0)) - brake
    follows = (features[:, LEADER] > 0) & (gap > 0)
    return np.where(follows, (safe - features[:, SPEED]) / (TOKEN_STEPS * STEP_S), np.inf)
