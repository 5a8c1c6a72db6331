"""The world holds exactly what it was told, for every vehicle, wherever it is."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from scex_sumo.base.arrays import FloatArray
from scex_sumo.base.errors import SimulationError
from scex_sumo.scene import SeedScene, States
from scex_sumo.world.base import BatchStart, SumoDriven, WorldRequest
from scex_sumo.world.sumo import SumoWorld
from scex_sumo.world.tiles import TILE_SLOTS
from tests.seeds import same_bytes, seed_of, standing, states_of


def scene_of(x: FloatArray, y: FloatArray, heading: FloatArray, speed: FloatArray) -> SeedScene:
    """Cars 4.5 m x 1.8 m, and a lorry first, that have stood still until now."""
    n = len(x)
    return seed_of(
        standing(states_of(*zip(x, y, heading, speed, strict=True))),
        track_ids=np.arange(10, 10 + n),
        types=("truck", *("car",) * (n - 1)),
        length=np.array([9.3, *[4.5] * (n - 1)]),
        width=np.array([2.5, *[1.8] * (n - 1)]),
    )


def trips(t: float, phase: FloatArray) -> States:
    """Where 11 vehicles are after t seconds, in futures that differ by a phase (C,)."""
    n = len(phase)
    s = States.empty((n, 11))
    for v in range(4):  # circles around the junction, over all its arms, with and against the traffic
        radius, turn = 6.0 + 25.0 * v, (-1.0) ** v * 9.0 / (6.0 + 25.0 * v)
        angle = phase + v + turn * t
        s.x[:, v], s.y[:, v] = 1000 + radius * np.cos(angle), 1000 + radius * np.sin(angle)
        s.heading[:, v] = angle + np.copysign(np.pi / 2, turn)
        s.speed[:, v] = radius * abs(turn)
    along = phase + 12.0 * t
    s.x[:, 4], s.y[:, 4] = 880 + along, 980 + 20 * np.sin(along / 30)  # weaves along and across the lanes
    s.heading[:, 4], s.speed[:, 4] = np.arctan(20 / 30 * np.cos(along / 30)), 12.0
    s.x[:, 5:7], s.y[:, 5:7], s.heading[:, 5:7], s.speed[:, 5:7] = 960.0, 995.2, 0.0, 0.0  # one on the other
    s.x[:, 7], s.y[:, 7] = 1100 + 3 * t, 1125 + phase  # 100 m from the nearest lane
    s.heading[:, 7], s.speed[:, 7] = 0.0, 3.0
    s.x[:, 8], s.y[:, 8], s.heading[:, 8], s.speed[:, 8] = 1100 + 40 * t, 1018.0, 0.0, 40.0  # off the map
    s.x[:, 9], s.y[:, 9], s.heading[:, 9], s.speed[:, 9] = 1080 - 14 * t, 1000.0, -3.0, 14.0  # ghost driver
    s.x[:, 10], s.y[:, 10], s.heading[:, 10], s.speed[:, 10] = 1000.0, 1001.0, phase + 2 * t, 5.0  # spins
    return s


def difference(a: States, b: States) -> float:
    """Largest difference in m, rad or m/s."""
    turn = np.angle(np.exp(1j * (a.heading - b.heading)))
    return max(np.abs(d).max() for d in (a.x - b.x, a.y - b.y, turn, a.speed - b.speed))


@pytest.fixture
def scene() -> SeedScene:
    first = trips(0.0, np.zeros(1))[0]
    return scene_of(first.x, first.y, first.heading, first.speed)


@pytest.mark.parametrize("with_a_driver_of_sumo", [False, True])
def test_what_is_read_is_what_was_planned_for_1e5_vehicle_steps_and_nobody_is_lost(
    crossing: SimpleNamespace, scene: SeedScene, with_a_driver_of_sumo: bool
) -> None:
    phase, slots = np.linspace(0.0, 6.0, TILE_SLOTS), np.arange(TILE_SLOTS)
    moved, drivers = np.ones((TILE_SLOTS, 11), dtype=bool), []
    if with_a_driver_of_sumo:
        moved[:, 5] = False
        drivers = [
            SumoDriven(future=c, vehicle=5, model="IDM", parameters={}, edges=("w_in", "e_out"))
            for c in range(TILE_SLOTS)
        ]
    with SumoWorld(WorldRequest(net=crossing, scene=scene, slots=slots)) as world:
        world.begin(BatchStart(slots=slots, driven=drivers), trips(0.0, phase))
        worst = difference(world.read(), trips(0.0, phase))
        for step in range(1, 159):  # 64 futures x (10 or 11) vehicles x 158 steps > 1e5
            plan = trips(0.1 * step, phase)
            world.move(plan, moved)
            world.step()
            worst = max(worst, difference(world.read()[moved], plan[moved]))
    # Coordinates reach 1e4 m in the last tile: 1e-9 m is a few hundred units in the last place.
    assert worst < 1e-9


def roll(world: SumoWorld, slots: list[int], phase: FloatArray) -> States:
    """Ten steps of some futures."""
    world.begin(BatchStart(slots=np.array(slots)), trips(0.0, phase))
    everybody, read = np.ones((len(slots), 11), dtype=bool), []
    for step in range(1, 11):
        world.move(trips(0.1 * step, phase), everybody)
        world.step()
        read.append(world.read())
    return States.stack(read, axis=0)


def test_a_future_reads_the_same_bytes_in_its_slot_whatever_runs_beside_or_before_it(
    crossing: SimpleNamespace, scene: SeedScene
) -> None:
    with SumoWorld(WorldRequest(net=crossing, scene=scene, slots=range(TILE_SLOTS))) as world:
        roll(world, [0, 1, 2], np.array([4.0, 5.0, 6.0]))
        among = roll(world, [62, 37, 5], np.array([1.0, 2.0, 3.0]))[:, 1]
    with SumoWorld(WorldRequest(net=crossing, scene=scene, slots=[37])) as world:
        alone = roll(world, [37], np.array([2.0]))[:, 0]
    assert same_bytes(among, alone)


def test_futures_without_drivers_of_sumo_share_a_tile_and_take_no_notice_of_each_other(
    crossing: SimpleNamespace, scene: SeedScene
) -> None:
    phase = np.array([2.0, 2.0, 5.0])  # the first two on top of each other all the way
    with SumoWorld(WorldRequest(net=crossing, scene=scene, slots=[0])) as world:
        together = roll(world, [0, 0, 0], phase)
        alone = [roll(world, [0], phase[[future]]) for future in range(3)]
    assert all(same_bytes(together[:, future], alone[future][:, 0]) for future in range(3))


def test_a_driver_of_sumo_in_its_tile_changes_nothing_about_vehicles_that_are_moved(
    crossing: SimpleNamespace, scene: SeedScene
) -> None:
    # With a driver of SUMO's to see them, SUMO looks for the lanes that vehicles are on; else it does not.
    phase, moved = np.array([2.0]), np.ones((1, 11), dtype=bool)
    driver = SumoDriven(future=0, vehicle=5, model="Krauss", parameters={}, edges=("w_in", "e_out"))
    moved[0, 5] = False
    with SumoWorld(WorldRequest(net=crossing, scene=scene, slots=[37])) as world:
        alone = roll(world, [37], phase)
        world.begin(BatchStart(slots=np.array([37]), driven=[driver]), trips(0.0, phase))
        for step in range(1, 11):
            world.move(trips(0.1 * step, phase), moved)
            world.step()
            read = world.read()
            assert read[moved].x.tobytes() == alone[step - 1][moved].x.tobytes()
            assert read[moved].y.tobytes() == alone[step - 1][moved].y.tobytes()
            assert read[moved].heading.tobytes() == alone[step - 1][moved].heading.tobytes()
            assert read[moved].speed.tobytes() == alone[step - 1][moved].speed.tobytes()


def test_a_vehicle_that_nobody_moves_is_an_error_with_counts(
    crossing: SimpleNamespace, scene: SeedScene
) -> None:
    start = trips(0.0, np.zeros(2))
    mask = np.ones((2, 11), dtype=bool)
    mask[0, 3:5] = False
    with SumoWorld(WorldRequest(net=crossing, scene=scene, slots=[0, 1])) as world:
        world.begin(BatchStart(slots=np.array([0, 1])), start)
        with pytest.raises(SimulationError, match="2 vehicles not moved"):
            world.move(start, mask)


def test_a_second_world_in_the_process_is_refused_until_the_first_is_closed(
    crossing: SimpleNamespace, scene: SeedScene
) -> None:
    start = trips(0.0, np.zeros(1))
    with SumoWorld(WorldRequest(net=crossing, scene=scene, slots=[0])) as first:
        first.begin(BatchStart(slots=np.array([0])), start)
        with (
            SumoWorld(WorldRequest(net=crossing, scene=scene, slots=[0])) as second,
            pytest.raises(SimulationError, match="one is open"),
        ):
            second.begin(BatchStart(slots=np.array([0])), start)
        assert difference(first.read(), start) < 1e-9
    with SumoWorld(WorldRequest(net=crossing, scene=scene, slots=[0])) as third:
        third.begin(BatchStart(slots=np.array([0])), start)
        assert difference(third.read(), start) < 1e-9
