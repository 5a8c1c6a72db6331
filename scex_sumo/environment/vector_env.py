"""Vector environment: many futures of one seed scene side by side, an agent in each; and a single one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.base.errors import UsageError, listed
from scex_sumo.base.files import TemporaryFolder
from scex_sumo.behaviors.base import PLAN_STEPS, driven_by_sumo
from scex_sumo.behaviors.driving.paths import BEHIND_M, seed_paths
from scex_sumo.drivers.registry import DEFAULT_MODELS
from scex_sumo.environment.agent import (
    MAX_OBSERVED,
    AgentSteps,
    Observation,
    Reward,
    controlled,
    default_reward,
    finite_numbers,
    observed,
    one_of,
    path_ahead,
    planned,
    whole_number,
)
from scex_sumo.extrapolation.assignments import future_generator, random_assignments, route_draws
from scex_sumo.extrapolation.job import ruled
from scex_sumo.extrapolation.loop.crashes import Crashes, slide
from scex_sumo.extrapolation.loop.rollout import checked_plan, groups_of, history_at
from scex_sumo.extrapolation.loop.situations import plans_of
from scex_sumo.extrapolation.models import ModelSet
from scex_sumo.extrapolation.settings import MAX_FUTURES, MAX_STEPS, Models, RunSettings
from scex_sumo.geometry.polylines import wrap
from scex_sumo.lanelet2sumo.convert import converted
from scex_sumo.plug_in.inputs import Surroundings, predictor_inputs
from scex_sumo.scenarios.seeds import read_seed
from scex_sumo.scene import STEP_S, SceneHistory, SeedScene, States, VehicleIndex
from scex_sumo.world.plain import PlainWorld


class SeedVectorEnv(VectorEnv[Any, Any, Any]):
    """N futures of a seed scene; the agent is one vehicle of each, models are drawn for the others.

    The world is the plain one, which equals SUMO's to the bit where SUMO drives no vehicle. Drivers are drawn
    independently for each episode. An environment resets itself at the step after its end.

    An observation is what `predictor_inputs` gives to a driver model, and ``path`` (10, 2): the agent's path
    ahead in its frame, every 3 m. ``terminated``: the agent touches another vehicle. Collided others
    slide to rest.
    """

    metadata: dict[str, Any] = {"autoreset_mode": AutoresetMode.NEXT_STEP, "render_modes": []}  # noqa: RUF012

    _age: IntArray  # (N,) steps since the seed scene
    _future: IntArray  # (N,) numbers of the episodes
    _ended: BoolArray
    _arc_length: FloatArray  # (N,) arc lengths of the agents on their paths, m
    _length: FloatArray

    def __init__(
        self,
        num_envs: int = 385,
        *,
        seed_scene: SeedScene | str | Path,
        agent: int | None = None,
        models: Models = DEFAULT_MODELS,
        assign: Mapping[int, str] | None = None,
        steps: int = 30,
        replan: int = 5,
        hold: int = 1,
        path: int = 0,
        action: Literal["control", "plan"] = "control",
        observation: Literal["flat", "dict"] = "flat",
        surroundings: Surroundings | None = None,
        reward: Reward = default_reward,
    ) -> None:
        """Make N environments.

        Args:
            seed_scene: scene with its road, or a file that `read_seed` reads.
            agent: track id; None for the first vehicle.
            models: as `extrapolate`; so ``assign``, ``steps`` (at which episodes are truncated), ``replan``.
            hold: steps of 0.1 s that an action is held.
            path: the agent's path by index from left to right; progress counts along it.
            action: ``control``: acceleration (1: 4 m/s², -1: -8 m/s²) and steering (1: 0.5 rad to the left);
                ``plan``: (hold, 2) positions in the agent's frame, m, one per step.
            observation: ``flat``: one array; ``dict``: named arrays.
            surroundings: what the agent sees; None for 8 neighbours and 16 lane pieces within 50 m.
            reward: of the (N,) agents for an action.

        Raises:
            UsageError: an argument makes no sense.
        """
        num_envs = whole_number("num_envs", num_envs, 1, MAX_FUTURES)
        steps = whole_number("steps", steps, 1, MAX_STEPS)
        replan = whole_number("replan", replan, 1, PLAN_STEPS)
        hold = whole_number("hold", hold, 1, steps)
        self._controls = one_of("action", action, ("control", "plan")) == "control"
        self._flat = one_of("observation", observation, ("flat", "dict")) == "flat"
        if not callable(reward):
            raise UsageError(f"reward: got {reward!r}, needs a function of `AgentSteps`")
        if surroundings is not None and not isinstance(surroundings, Surroundings):
            raise UsageError(f"surroundings: got {surroundings!r}, needs `scex_sumo.Surroundings`")
        if not isinstance(seed_scene, SeedScene | str | Path):
            raise UsageError(f"seed_scene: got {type(seed_scene).__name__}, needs a seed scene or a file")
        scene = seed_scene if isinstance(seed_scene, SeedScene) else read_seed(seed_scene)
        if (road := scene.road) is None:
            raise UsageError("seed_scene: has no road; read it together with its map")
        tracks = scene.track_ids.tolist()
        self.agent = tracks[0] if agent is None else agent
        self._check_vehicles(tracks, assign)
        settings = RunSettings(models=models, assign=assign or {}, steps=steps, replan=replan)
        self._models = ModelSet.of(settings)
        for name, model in zip(self._models.names, self._models.built, strict=True):
            if driven_by_sumo(model):
                raise UsageError(f"models: SUMO drives the vehicles of {name}; an environment has no SUMO")
        with TemporaryFolder() as folder:
            scene, _ = ruled(scene, converted(road, Path(folder) / "road.net.xml"), settings)
        self.scene, self.road = scene, road
        self.num_envs, self.steps, self.replan, self.hold = num_envs, steps, replan, hold
        self._vehicle = tracks.index(self.agent)
        self._reward = reward
        self._surroundings = surroundings or Surroundings(neighbours=8, lanes=16)
        self._paths = seed_paths(scene, self.road, steps * STEP_S + 5.0)
        last = int(self._paths.count[self._vehicle]) - 1
        path = whole_number(f"path of vehicle {self.agent}", path, -last - 1, last)
        self._path = self._paths.choose(path, np.full(num_envs, self._vehicle), np.zeros(num_envs))
        self._world = PlainWorld(num_envs, scene.vehicles, length=scene.length)
        self._begin(0)
        box, limit = gymnasium.spaces.Box, MAX_OBSERVED
        self.single_action_space = box(-1.0, 1.0, (2,)) if self._controls else box(-100.0, 100.0, (hold, 2))
        spaces: dict[str, gymnasium.Space[Any]] = {
            name: box(-limit, limit, a.shape[1:]) for name, a in self._arrays().items()
        }
        every = gymnasium.spaces.Dict(spaces)
        self.single_observation_space = gymnasium.spaces.flatten_space(every) if self._flat else every
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Put all environments to the seed scene, with newly drawn drivers."""
        super().reset(seed=seed)
        self._begin(int(self.np_random.integers(2**31)) if seed is None else seed)
        return self._observation(), self._info()

    def step(
        self, actions: FloatArray
    ) -> tuple[Observation, FloatArray, BoolArray, BoolArray, dict[str, Any]]:
        """Advance all environments by ``hold`` steps; those that had ended begin again instead."""
        actions = finite_numbers("actions", actions, self.action_space.shape or ())
        begins = self._ended.copy()
        before, came_from = self._agent_now(), self._arc_length
        collided = np.zeros(self.num_envs, dtype=bool)
        plan = None if self._controls else planned(before, actions)
        for held in range(self.hold):
            self._plan()
            now = self._agent_now()
            mine = controlled(now, self._length, actions) if plan is None else plan[:, held]
            collided |= self._advance(mine, moving=~(begins | collided))
        if begins.any():
            self._renew(np.flatnonzero(begins))
        self._arc_length, offset = self._on_path()
        after, seconds = self._agent_now(), self.hold * STEP_S
        turn = wrap(after.heading - before.heading)
        done = AgentSteps(
            collided=collided,
            progress=self._arc_length - came_from,
            offset=offset,
            speed=after.speed,
            speed_limit=self._paths.speed_limit.ravel()[self._paths.sample_at(self._path, self._arc_length)],
            acceleration=(after.speed - before.speed) / seconds,
            lateral=(after.speed + before.speed) / 2 * turn / seconds,
            seconds=seconds,
        )
        rewards = np.where(begins, 0.0, finite_numbers("reward", self._reward(done), (self.num_envs,)))
        terminated = collided & ~begins
        truncated = (self._age >= self.steps) & ~terminated & ~begins
        self._ended = terminated | truncated
        return self._observation(), rewards, terminated, truncated, self._info()

    def begin_again(self, ended: BoolArray) -> Observation:
        """Put the (N,) ended environments to the seed scene at once; return what all agents see."""
        self._renew(np.flatnonzero(ended))
        self._arc_length, _ = self._on_path()
        return self._observation()

    def _check_vehicles(self, tracks: Sequence[int], assign: Mapping[int, str] | None) -> None:
        if assign is not None and not isinstance(assign, Mapping):
            raise UsageError(f"assign: got {type(assign).__name__}, needs a mapping from track id to model")
        for argument, track in [("agent", self.agent), *(("assign", track) for track in assign or ())]:
            if track not in tracks:
                raise UsageError(
                    f"{argument}: no vehicle {track} in the seed scene; its vehicles: "
                    f"{listed(tracks, most=12)}"
                )
        if self.agent in (assign or ()):
            raise UsageError(f"assign: vehicle {self.agent} is the agent")

    def _begin(self, seed: int) -> None:
        count, shape = self.num_envs, (self.num_envs, self.scene.vehicles)
        self._seed = seed
        self._future = np.arange(count) - count  # `_renew` adds N: future numbers never come again
        self._age = np.zeros(count, dtype=np.int64)
        self._ended = np.zeros(count, dtype=bool)
        self._assignment = np.zeros(shape, dtype=np.int64)
        self._route_draw = np.zeros(shape)
        self._generators = [future_generator(seed, 0)] * count
        self._window = self.scene.history.repeat(count)
        self._next = States.empty((*shape, self.replan))
        self._length = np.full(count, self.scene.length[self._vehicle])
        self._crashes = Crashes(self.scene, count)
        self._renew(np.arange(count))
        self._arc_length, _ = self._on_path()

    def _renew(self, index: IntArray) -> None:
        self._future[index] += self.num_envs
        futures, seed = self._future[index], self._seed
        weights = [spec.weight for spec in self._models.drawn]
        drawn = random_assignments(weights, futures, self.scene.vehicles, seed=seed)
        for track, model in self._models.fixed.items():
            drawn[:, self.scene.track_ids.tolist().index(track)] = model
        self._assignment[index] = drawn
        self._assignment[index, self._vehicle] = -1
        self._route_draw[index] = route_draws(futures, self.scene.vehicles, seed=seed)
        for place, future in zip(index.tolist(), futures.tolist(), strict=True):
            self._generators[place] = future_generator(seed, future)
        self._age[index] = 0
        self._ended[index] = False
        self._window.assign(index, self.scene.history.repeat(len(index)))
        self._crashes.crashed[index] = False

    def _plan(self) -> None:
        due = (self._age % self.replan == 0) & ~self._ended
        for age in np.unique(self._age[due]).tolist():
            envs = np.flatnonzero(due & (self._age == age))
            history = self._history(envs, age)
            plan = States.empty((len(envs), self.scene.vehicles, self.replan))
            drivers = np.where(self._crashes.crashed[envs], -1, self._assignment[envs])
            groups = groups_of(drivers, len(self._models.built))
            generators = [self._generators[env] for env in envs.tolist()]
            plans = plans_of(self._models.built, groups, history, self.road, generators, self.replan)
            for m, model_plan in plans:
                usable = checked_plan(model_plan, len(groups[m]), self.replan, self._models.names[m])
                plan.assign((groups[m].future, groups[m].vehicle), usable)
            crashed = self._crashes.crashed[envs]
            now = history.now[crashed]
            plan.assign(np.nonzero(crashed), slide(now, now.speed, self.replan))
            self._next.assign(envs, plan)

    def _advance(self, mine: States, *, moving: BoolArray) -> BoolArray:
        """Move the ``moving`` environments by one step; return (N,) whether their agents touch a vehicle."""
        every, before = np.arange(self.num_envs), self._window[:, :, -1]
        states = self._next[every, :, self._age % self.replan]
        states.assign((every, self._vehicle), mine)
        states = States.joined([states, before], lambda ab: np.where(moving[:, None], *ab))
        self._world.move(states, np.ones(states.shape, dtype=bool))
        self._world.step()
        read = self._world.read()
        self._window = States.concatenate([self._window[:, :, 1:], read[:, :, None]], axis=2)
        self._age = self._age + moving
        (future, vehicle), motion = self._crashes.after_step(before, read, self.replan)
        for step in range(self.replan):
            self._next.assign((future, vehicle, (self._age[future] + step) % self.replan), motion[:, step])
        return np.isin(every, future[vehicle == self._vehicle]) & moving

    def _history(self, envs: IntArray | slice, age: int) -> SceneHistory:
        window, draws = self._window[envs], self._route_draw[envs]
        return history_at(self.scene, window, self._future[envs], draws, step=age)

    def _agent_now(self) -> States:
        return self._window[:, self._vehicle, -1]

    def _on_path(self) -> tuple[FloatArray, FloatArray]:
        """Return (N,) arc lengths and offsets of the agents on their path, m."""
        now, start = self._agent_now(), float(self.scene.now.speed[self._vehicle])
        expected = BEHIND_M + self._age * STEP_S * (start + now.speed) / 2
        arc_length, offset, _ = self._paths.foot_points(self._path, now.x, now.y, expected)
        return arc_length, offset

    def _arrays(self) -> dict[str, FloatArray]:
        every = np.arange(self.num_envs)
        vehicles = VehicleIndex(future=every, vehicle=np.full(self.num_envs, self._vehicle))
        history = self._history(slice(None), 0)
        arrays = predictor_inputs(history, self.road, vehicles, self._surroundings, step=self._age)
        return {**arrays, "path": path_ahead(self._paths, self._path, self._arc_length, self._agent_now())}

    def _observation(self) -> Observation:
        return observed(self._arrays(), flat=self._flat)

    def _info(self) -> dict[str, Any]:
        return {"future": self._future.copy(), "step": self._age.copy()}


class SeedEnv(gymnasium.Env[Any, Any]):
    """One future of a seed scene; arguments, actions and observations as `SeedVectorEnv`."""

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012

    def __init__(self, **arguments: Any) -> None:
        self._one = SeedVectorEnv(1, **arguments)
        self.action_space = self._one.single_action_space
        self.observation_space = self._one.single_observation_space

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Put the scene back, with newly drawn drivers."""
        super().reset(seed=seed)
        observation, info = self._one.reset(seed=seed)
        return self._first(observation), self._first(info)

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Advance by the steps that an action is held."""
        batch = action[None] if isinstance(action, np.ndarray) else [action]
        observation, reward, ended, cut, info = self._one.step(batch)  # type: ignore[arg-type]
        return self._first(observation), float(reward[0]), bool(ended[0]), bool(cut[0]), self._first(info)

    @staticmethod
    def _first(batch: Any) -> Any:
        return {name: v[0] for name, v in batch.items()} if isinstance(batch, dict) else batch[0]
