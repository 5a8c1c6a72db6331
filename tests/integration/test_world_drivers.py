"""SUMO's own drivers among vehicles that are moved: what they see, where they go, and that no tile matters.

On the main road of the net (conftest.py) the inner lane from the west runs along y = 998.4 from x = 960 to
the junction at x = 992, and goes on at y = 998.4 beyond it; the speed limit is 13.9 m/s.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from xml.etree import ElementTree

import libsumo
import numpy as np
import pytest

from scex_sumo.base.errors import UsageError
from scex_sumo.base.sumo.car_following import SUMO_MODELS
from scex_sumo.scenarios import example_path
from scex_sumo.scenarios.seeds import read_seed
from scex_sumo.scene import Obstacles, SeedScene, States
from scex_sumo.world.base import BatchStart, SumoDriven, WorldRequest
from scex_sumo.world.batch import RunningBatch
from scex_sumo.world.sumo import SumoWorld
from tests.command import script
from tests.formats.sumo.simulations import write_grid
from tests.runs import extrapolate
from tests.seeds import people_of, same_bytes, seed_of, standing, states_of, steady

STRAIGHT = ("w_in", "e_out")


def scene(*vehicles: tuple[float, float, float, float], obstacles: Obstacles | None = None) -> SeedScene:
    """Cars of 4.5 m at (x, y, heading, speed)."""
    return seed_of(standing(states_of(*vehicles)), obstacles=obstacles)


def driven(
    vehicle: int, model: str, edges: Sequence[str] = STRAIGHT, future: int = 0, **parameters: str
) -> SumoDriven:
    return SumoDriven(future=future, vehicle=vehicle, model=model, parameters=parameters, edges=tuple(edges))


def drive(
    world: SumoWorld, scene: SeedScene, slots: Sequence[int], drivers: Sequence[SumoDriven], steps: int
) -> States:
    """(C, V, steps + 1) states, the seed scene first; vehicles that are moved keep heading and speed."""
    states = scene.now.repeat(len(slots))
    mask = np.ones(states.shape, dtype=bool)
    for d in drivers:
        mask[d.future, d.vehicle] = False
    world.begin(BatchStart(slots=np.array(slots), driven=drivers), states)
    read = [world.read()]
    for _ in range(steps):
        states = states.ahead(0.1 * states.speed[..., None], states.speed[..., None])[..., 0]
        world.move(states, mask)
        if scene.obstacles is not None:
            world.move_obstacles(scene.obstacles.states[:, 10], scene.obstacles.present[:, 10])
        world.step()
        read.append(world.read())
    return States.stack(read, axis=2)


def in_north(before_m: float, speed: float) -> tuple[float, float, float, float]:
    """A car in the only lane from the north, (988.40, 1129.88) to (997.59, 1010.51), before its end."""
    heading = np.arctan2(1010.51 - 1129.88, 997.59 - 988.40)
    return 997.59 - before_m * np.cos(heading), 1010.51 - before_m * np.sin(heading), heading, speed


@pytest.mark.parametrize("model", SUMO_MODELS)
def test_a_driver_of_sumo_stops_behind_a_standing_vehicle_that_is_moved(
    crossing: SimpleNamespace, model: str
) -> None:
    seed = scene(in_north(20.0, 0.0), in_north(60.0, 8.0))
    with SumoWorld(WorldRequest(net=crossing, scene=seed, slots=[0])) as world:
        read = drive(world, seed, [0], [driven(1, model, ("n_in", "s_out"))], 200)
    gap = np.hypot(read.x[0, 1] - read.x[0, 0], read.y[0, 1] - read.y[0, 0]) - 4.5
    assert gap[0] == pytest.approx(35.5)
    assert read.speed[0, 1, -1] < 1.0  # ACC creeps up for half a minute
    assert gap.min() > 0.0 and gap[-1] < 15.0  # W99 does not keep SUMO's minimum gap of 2.5 m


def test_a_driver_of_sumo_follows_its_route_through_the_junction(crossing: SimpleNamespace) -> None:
    seed = scene((975.0, 995.2, 0.0, 10.0), (975.0, 998.4, 0.0, 10.0), (964.0, 998.4, 0.0, 10.0))
    drivers = [
        driven(0, "Krauss", ("w_in", "s_out")),
        driven(1, "Krauss", ("w_in", "e_out")),
        driven(2, "Krauss", ("w_in", "n_out")),
    ]
    with SumoWorld(WorldRequest(net=crossing, scene=seed, slots=[0])) as world:
        read = drive(world, seed, [0], drivers, 150)
    x, y = read.x[0, :, -1], read.y[0, :, -1]
    assert y[0] < 960.0 and abs(x[0] - 1003.0) < 10.0  # right, southwards
    assert x[1] > 1050.0  # straight on, eastwards
    assert y[2] > 1020.0 and abs(x[2] - 999.0) < 10.0  # left, northwards


def test_a_driver_of_sumo_gives_way_to_a_vehicle_that_is_moved(crossing: SimpleNamespace) -> None:
    # Four cars creep along the main road: the last one leaves the junction, 962 -> 1008, after 11.5 s.
    # From the minor road it is 3 s to the junction.
    queue = [(962.0 + 10.0 * k, 998.4, 0.0, 4.0) for k in range(4)]
    seed = scene(in_north(25.0, 8.0), *queue)
    with SumoWorld(WorldRequest(net=crossing, scene=seed, slots=[0])) as world:
        read = drive(world, seed, [0], [driven(0, "Krauss", ("n_in", "s_out"))], 200)
    # Its front, 2.25 m ahead of its centre, stays out of their lane, which begins at y = 1000; then it goes.
    assert np.all(read.y[0, 0, :110] - 2.25 > 1000.0)
    assert read.y[0, 0, -1] < 990.0
    others = np.hypot(read.x[0, 1:] - read.x[0, 0], read.y[0, 1:] - read.y[0, 0])
    assert others.min() > 4.0


def obstacle(x: float, y: float, heading: float = np.pi / 2) -> Obstacles:
    """Somebody who stands there."""
    return people_of(steady((x, y, heading, 0.0)))


@pytest.mark.parametrize("heading", [-1.5, 0.0, 1.6, 3.1])
def test_a_driver_of_sumo_stops_for_somebody_on_the_lane(crossing: SimpleNamespace, heading: float) -> None:
    x, y, _, _ = in_north(20.0, 0.0)
    seed = scene(in_north(60.0, 8.0), obstacles=obstacle(x, y, heading))
    with SumoWorld(WorldRequest(net=crossing, scene=seed, slots=[3])) as world:
        read = drive(world, seed, [3], [driven(0, "EIDM", ("n_in", "s_out"))], 100)
    gap = np.hypot(read.x[0, 0] - x, read.y[0, 0] - y) - 2.25
    assert read.speed[0, 0, -1] < 0.2 and 0.3 < gap[-1] < 6.0


def mixed() -> SeedScene:
    """Leaders, followers, a blocked lane to change from, crossing traffic."""
    return scene(
        (988.0, 998.4, 0.0, 0.0),
        (965.0, 998.7, 0.05, 13.0),
        (900.0, 978.8, 0.2, 13.0),
        (885.0, 978.4, 0.0, 15.0),
        in_north(40.0, 8.0),
    )


def mixed_drivers(model: str, future: int) -> list[SumoDriven]:
    routes = {1: STRAIGHT, 2: ("w_in", "n_out"), 3: ("w_in", "s_out"), 4: ("n_in", "s_out")}
    return [driven(v, model, edges, future) for v, edges in routes.items()]


@pytest.mark.parametrize("model", SUMO_MODELS)
def test_a_driver_of_sumo_does_the_same_to_the_byte_in_its_tile(
    crossing: SimpleNamespace, model: str
) -> None:
    seed = mixed()

    def run(world: SumoWorld, slots: list[int]) -> States:
        drivers = [d for future in range(len(slots)) for d in mixed_drivers(model, future)]
        return drive(world, seed, slots, drivers, 60)

    with SumoWorld(WorldRequest(net=crossing, scene=seed, slots=range(64))) as world:
        drive(world, seed, [2, 5, 40], [], 7)
        run(world, [40, 0, 2, 1])
        among = run(world, [33, 2, 40])[2]
    with SumoWorld(WorldRequest(net=crossing, scene=seed, slots=[40])) as world:
        alone = run(world, [40])[0]
    assert same_bytes(among, alone)


def test_traffic_lights_begin_anew_with_every_batch(signals: SimpleNamespace) -> None:
    seed = scene(in_north(40.0, 8.0), (950.0, 995.0, 0.32, 10.0))
    drivers = [driven(0, "Krauss", ("n_in", "s_out")), driven(1, "Krauss", STRAIGHT)]
    with SumoWorld(WorldRequest(net=signals, scene=seed, slots=[0])) as world:
        first = drive(world, seed, [0], drivers, 600)
        again = drive(world, seed, [0], drivers, 600)
    assert first.speed[0, 0].min() == 0.0  # waits at the red light
    assert first.y[0, 0, -1] < 980.0  # and passes when it is green, after three quarters of a minute
    assert first.x.tobytes() == again.x.tobytes() and first.y.tobytes() == again.y.tobytes()


@pytest.mark.parametrize(
    ("model", "parameters", "words"),
    [
        ("Kraus", {}, "unknown SUMO model 'Kraus'; known: Krauss"),
        ("Krauss", {"tua": "1"}, "unknown parameter 'tua'"),
        ("Krauss", {"sigma": "0.5"}, "makes the driver random"),
        ("Krauss", {"tau": "short"}, "tau=short is not a number"),
    ],
)
def test_a_driver_that_sumo_does_not_have_is_an_error(
    crossing: SimpleNamespace, model: str, parameters: dict[str, str], words: str
) -> None:
    seed = mixed()
    with (
        SumoWorld(WorldRequest(net=crossing, scene=seed, slots=[0])) as world,
        pytest.raises(UsageError, match=words),
    ):
        drive(world, seed, [0], [driven(1, model, **parameters)], 1)


@pytest.mark.parametrize("vru", ["replay", "model"])
def test_a_pedestrian_is_a_person_on_no_walking_area_and_a_cyclist_a_bicycle(
    vru: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Libsumo 1.28 shifts persons on walking areas, or crashes."""
    lanes, classes = list[str](), set[str]()
    advance = SumoWorld._advance

    def recorded(world: SumoWorld, batch: RunningBatch) -> None:
        advance(world, batch)
        lanes.extend(map(libsumo.person.getLaneID, libsumo.person.getIDList()))
        classes.update(map(libsumo.vehicle.getVehicleClass, libsumo.vehicle.getIDList()))

    monkeypatch.setattr(SumoWorld, "_advance", recorded)
    seed = read_seed(example_path("urban_intersection"))
    models = "sumo:EIDM,keeps_way" if vru == "model" else "sumo:EIDM"
    extrapolate(seed, models=models, vru=vru, futures=1, steps=10, out=tmp_path / "run")
    assert len(lanes) == 11 and not any("_w" in lane for lane in lanes)
    assert classes == {"passenger", "bicycle"}


def crossing_of(net: Path) -> tuple[str, np.ndarray]:
    """A crossing's lane before which vehicles from A0 have to stop, and its ends."""
    (lane,) = (lane for lane in ElementTree.parse(net).iter("lane") if lane.get("id") == ":A1_c2_0")
    ends = [[float(value) for value in point.split(",")] for point in lane.attrib["shape"].split()]
    return lane.attrib["id"], np.array(ends)


def test_a_driver_of_sumo_stops_before_a_person_on_a_crossing(tmp_path: Path) -> None:
    """It drove on, at 14 m/s, while the person was a vehicle in SUMO."""
    net = write_grid(tmp_path).net
    _, (start, *_, end) = crossing_of(net)
    (lane,) = (lane for lane in ElementTree.parse(net).iter("lane") if lane.get("id") == "A0A1_1")
    x, y = (float(value) for value in lane.attrib["shape"].split()[0].split(","))
    where = start + (x - start[0]) / (end - start)[0] * (end - start)
    seed = scene((x, y + 20.0, np.pi / 2, 10.0), obstacles=obstacle(where[0], where[1], 0.0))
    with SumoWorld(WorldRequest(net=SimpleNamespace(path=net, extras=None), scene=seed, slots=[0])) as world:
        read = drive(world, seed, [0], [driven(0, "EIDM", ("A0A1", "A1A2"))], 100)
        assert libsumo.person.getRoadID("t0_otherP1").startswith(":t0_A1_c")
    gap = where[1] - read.y[0, 0] - 2.25
    assert read.speed[0, 0, -1] < 0.2 and 0.3 < gap[-1] < 10.0


WALK = """
import sys
from pathlib import Path
from xml.etree import ElementTree

import libsumo
import numpy as np

import scex_sumo.world.tiles as tiles
from scex_sumo.world.persons import People, walking_places

tiles.tile_prefix = lambda slot: ""  # the net has no tiles
net, folder = Path(sys.argv[1]), Path(sys.argv[2])
types, empty = folder / "types.add.xml", str(folder / "empty.xml")
types.write_text('<additional><vType id="walks" vClass="passenger" maxSpeed="0.1"/></additional>')
options = ["-n", str(net), "-a", str(types), "--step-length", "0.1", "--no-warnings", "true"]
libsumo.simulation.start(["sumo", *options, "--no-step-log", "true", "--duration-log.disable", "true"])
libsumo.simulation.saveState(empty)
root = ElementTree.parse(net)
crossings = [edge for edge in root.iter("edge") if edge.get("function") == "crossing"]
spots = [edge.find("lane").get("shape").split()[0].split(",") for edge in crossings]
rng, places, most = np.random.default_rng(0), walking_places(net.read_bytes()), 0.0
for moment in range(30):
    libsumo.simulation.loadState(empty)
    persons, pick = People(libsumo, places, None, None, None), rng.integers(len(spots), size=14)
    at = np.array([[float(value) for value in spots[k][:2]] for k in pick]) + rng.normal(0, 3, (14, 2))
    heading, speed = rng.uniform(-np.pi, np.pi, 14), rng.uniform(0, 2, 14)
    for step in range(30):
        angle = np.degrees(np.pi / 2 - heading) % 360
        found, x, y = places.find(*at.T, angle)
        for k in range(14):
            persons.put(f"p{k}", "walks", 0, found[k], (float(x[k]), float(y[k]), float(angle[k])))
        libsumo.simulation.step()
        for k in range(14):
            lane = libsumo.person.getLaneID(f"p{k}") if found[k] else ""
            assert "_w" not in lane and ("_c" in lane) == found[k].startswith(":"), (lane, found[k])
            off = np.hypot(*np.subtract(libsumo.person.getPosition(f"p{k}"), (x[k], y[k])))
            most = max(most, off if found[k] != "lane" else 0.0)
        at += 0.1 * speed[:, None] * np.stack([np.cos(heading), np.sin(heading)], axis=1)
assert most < 0.02, most
print("walked")
"""


def test_many_people_that_walk_over_crossings_do_not_crash_sumo(tmp_path: Path) -> None:
    """On their own with ``moveToXY`` alone, libsumo 1.28 crashes after the second of these moments."""
    net = write_grid(tmp_path).net
    done = script(WALK, net, tmp_path)
    assert (done.returncode, done.stdout) == (0, "walked\n"), done.stderr


@pytest.mark.parametrize("kind", ["car", "bus", "pedestrian", "bicycle"])
def test_a_vehicle_that_is_moved_onto_a_crossing_is_on_no_walking_lane_of_sumo(
    kind: str, tmp_path: Path
) -> None:
    """As above, and as all vehicles beside those that SUMO drives."""
    net = write_grid(tmp_path).net
    (lane,) = (lane for lane in ElementTree.parse(net).iter("lane") if lane.get("id") == ":A1_c1_0")
    (x, y), *_, (to_x, to_y) = (map(float, point.split(",")) for point in lane.attrib["shape"].split())
    heading = np.arctan2(to_y - y, to_x - x)
    on_it = (0.5 * (x + to_x) - 2.0 * np.cos(heading), 0.5 * (y + to_y) - 2.0 * np.sin(heading), heading, 1.0)
    seed = replace(scene((0.0, 40.0, np.pi / 2, 5.0), on_it), types=("car", kind))
    lanes = []
    with SumoWorld(WorldRequest(net=SimpleNamespace(path=net, extras=None), scene=seed, slots=[0])) as world:
        drive(world, seed, [0], [driven(0, "EIDM", ("A0A1", "A1A2"))], 1)
        lanes.append(libsumo.vehicle.getLaneID("t0_2"))
    assert lanes[0] and "_c" not in lanes[0] and "_w" not in lanes[0]


def test_a_vehicle_that_is_taken_over_has_the_speed_that_is_set(crossing: SimpleNamespace) -> None:
    """As after a collision: it slides aside of its lane, and slows down."""
    seed = scene(in_north(60.0, 8.0), (900.0, 1100.0, 0.0, 0.0))
    with SumoWorld(WorldRequest(net=crossing, scene=seed, slots=[0])) as world:
        read = drive(world, seed, [0], [driven(0, "EIDM", ("n_in", "s_out"))], 3)[:, :, -1]
        heading = read.heading + 0.3
        for step in range(1, 6):
            speed = np.maximum(read.speed - 0.687 * step, 0.0)
            way = read.speed * 0.1 * step - 6.87 * (0.1 * step) ** 2 / 2
            x, y = read.x + way * np.cos(heading), read.y + way * np.sin(heading)
            world.move(States(x=x, y=y, heading=heading, speed=speed), np.ones(speed.shape, dtype=bool))
            world.step()
            assert world.read().speed[0, 0] == speed[0, 0]
