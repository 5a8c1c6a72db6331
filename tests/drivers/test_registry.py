"""Models by name: parsing, building, registering."""

from __future__ import annotations

import importlib.metadata
import importlib.util
import subprocess
import sys
from collections.abc import Sequence
from functools import partial

import numpy as np
import pytest

from scex_sumo.base.errors import UsageError
from scex_sumo.base.importing import Registry
from scex_sumo.behaviors.base import BatchBehavior
from scex_sumo.behaviors.models.idm import IdmDriver
from scex_sumo.behaviors.models.sumo import SumoDriver
from scex_sumo.drivers.decorators import behavior
from scex_sumo.drivers.listing import known_models
from scex_sumo.drivers.registry import (
    ModelSpec,
    build,
    entry_of,
    is_own,
    known_names,
    model_specs,
    parse_models,
)
from scex_sumo.plug_in.predictor import Predictor
from scex_sumo.plug_in.user_model import SingleVehicle
from scex_sumo.road import Road
from scex_sumo.scene import Plan, SceneHistory, States, VehicleIndex
from tests.behaviors import roads


def test_names_parameters_and_weights_are_read() -> None:
    specs = parse_models("standard_driver,graph_image_predictor:attention=0.8@2,sumo:EIDM:tau=1.2@0.5")
    assert specs == [
        ModelSpec(name="standard_driver"),
        ModelSpec(name="graph_image_predictor", parameters={"attention": "0.8"}, weight=2.0),
        ModelSpec(name="sumo:EIDM", parameters={"tau": "1.2"}, weight=0.5),
    ]
    assert [str(spec) for spec in specs] == [
        "standard_driver", "graph_image_predictor:attention=0.8", "sumo:EIDM:tau=1.2"
    ]  # fmt: skip


def test_a_set_stands_for_its_models() -> None:
    assert [spec.name for spec in parse_models("paper")] == [
        "standard_driver",
        "risky_driver",
        "constant_velocity",
        "emergency_brake",
        "graph_predictor",
        "graph_image_predictor",
    ]
    assert [str(spec) for spec in parse_models("rules,replay")][-2:] == ["emergency_brake", "replay"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("fast_driver", "unknown behavior 'fast_driver'; nearest: risky_driver, "),
        (
            "standard_driver:speed_limit=3",
            "standard_driver: unknown parameter 'speed_limit'; nearest: speed, ",
        ),
        ("graph_predictor:depth=3", "graph_predictor: unknown parameter 'depth'; nearest: path, "),
        ("stops:braking=2", "stops: unknown parameter 'braking'; it has none"),
        ("graph_predictor:mode=worst", "graph_predictor: mode: got 'worst'; give best or draw"),
        ("graph_predictor:path=left", "path=left is not an index, straight, random or likeliest"),
        ("standard_driver:path=likeliest", "path=likeliest is not an index, straight or random"),
        ("graph_image_predictor:attention=1.1", "attention: got 1.1; give a number from 0 to 1"),
        ("graph_image_predictor:attention=nan", "attention: got nan; give a number from 0 to 1"),
        ("graph_image_predictor:head=loose", "head: got 'loose'; give bounded or free"),
        ("standard_driver@often", "weight 'often' is not a number"),
        ("standard_driver@-1", "standard_driver: weight -1; give 0 or a number from 1e-06 to 1e\\+06"),
        ("standard_driver@nan", "weight nan; give 0 or a number from"),
        ("standard_driver@1e308,risky_driver@1e308", "weight 1e\\+308; give 0 or a number from"),
        ("standard_driver:max_acceleration=1e300", "max_acceleration: got 1e\\+300; give a number from"),
        ("likely_driver:spread=1e5", "likely_driver: spread: got 100000.0; give a number up to 100"),
        ("standard_driver:radius=inf", "radius: got inf; give a number from 1e-06 to 1e\\+06"),
        ("standard_driver:path=99999999999999999999", "path: got 99999999999999999999; give an index"),
        ("standard_driver@0,risky_driver@0", "all weights .* are 0"),
        ("standard_driver,risky_driver,standard_driver@3", "model standard_driver is given twice"),
        ("standard_driver:time_headway", "'time_headway' is not parameter=value"),
        ("standard_driver:time_headway=", "'time_headway=' is not parameter=value"),
        ("standard_driver:time_headway=1:time_headway=2", "parameter time_headway is given twice"),
        ("standard_driver:time_headway=long", "time_headway=long is not a number"),
        ("standard_driver:time_headway=-1", "standard_driver: time_headway: got -1.0"),
        ("standard_driver:path=left", "path=left is not an index, straight or random"),
        ("sumo", "name the SUMO model, one of Krauss"),
        ("sumo:tau=2", "name the SUMO model"),
        ("sumo:Newell", "unknown SUMO model 'Newell'; known: Krauss"),
        ("sumo:EIDM:colour=2", "sumo:EIDM: unknown parameter 'colour'"),
        ("", "no model in ''"),
    ],
)
def test_what_makes_no_sense_is_refused_in_one_line(text: str, message: str) -> None:
    with pytest.raises(UsageError, match=message) as caught:
        parse_models(text)
    assert "\n" not in str(caught.value)


def test_parameters_reach_the_model_and_the_others_keep_their_defaults() -> None:
    built = build(parse_models("risky_driver:time_headway=0.7:path=2")[0])
    assert isinstance(built, IdmDriver)
    assert (built.profile.time_headway, built.profile.path) == (0.7, 2)
    assert built.profile.comfort_deceleration == entry_of("risky_driver").profile.comfort_deceleration


def test_sumo_models_are_built_with_their_parameters_and_a_path() -> None:
    built = build(parse_models("sumo:Krauss:tau=0.8:path=1")[0])
    assert isinstance(built, SumoDriver)
    assert (built.model, built.parameters, built.path) == ("Krauss", {"tau": "0.8"}, 1)


def test_learned_drivers_are_listed_and_built_without_torch() -> None:
    code = (
        "import sys; sys.modules['torch'] = None\n"
        "from scex_sumo.drivers.registry import *\n"
        "from scex_sumo.drivers.listing import known_models\n"
        "known_models(); [build(spec).weights_sha256 for spec in parse_models(sys.argv[1])]"
    )
    subprocess.run([sys.executable, "-c", code, "graph_predictor,graph_image_predictor"], check=True)


def test_every_known_model_is_described_with_its_defaults() -> None:
    infos = {info.name: info for info in known_models()}
    assert set(infos) == set(known_names())
    assert "time_headway=3.1" in infos["standard_driver"].parameters
    assert all(info.summary and "\n" not in info.summary for info in infos.values())


class Parked:
    """Stays where it is."""

    def __init__(self, *, steps: int = 30, loud: bool = False) -> None:
        self.steps, self.loud = steps, loud

    def plan(
        self, history: SceneHistory, road: Road, vehicles: VehicleIndex, rng: Sequence[np.random.Generator]
    ) -> Plan:
        now = history.now[vehicles.future, vehicles.vehicle]
        x, y, heading = (np.repeat(a[:, None], self.steps, axis=1) for a in (now.x, now.y, now.heading))
        return Plan(x=x, y=y, heading=heading, speed=np.zeros_like(x))


@pytest.mark.usefixtures("registered_models")
def test_a_class_of_ones_own_becomes_a_model() -> None:
    assert behavior("parked")(Parked) is Parked
    built = build(parse_models("parked:steps=40:loud=true")[0])
    assert isinstance(built, Parked) and isinstance(built, BatchBehavior)
    assert (built.steps, built.loud) == (40, True)
    (info,) = (info for info in known_models() if info.name == "parked")
    assert info.summary == "Stays where it is."
    assert info.parameters == ("steps=30", "loud=false", "guard=false")
    with pytest.raises(UsageError, match="parked: unknown parameter 'height'; nearest: "):
        parse_models("parked:height=3")
    with pytest.raises(UsageError, match="steps=many is not a whole number"):
        parse_models("parked:steps=many")


def entry_points(monkeypatch: pytest.MonkeyPatch, value: str) -> None:
    point = importlib.metadata.EntryPoint(name="installed", value=value, group="scex_sumo.behaviors")
    there = [one for distribution in importlib.metadata.distributions() for one in distribution.entry_points]
    points = importlib.metadata.EntryPoints([*there, point])
    monkeypatch.setattr(importlib.metadata, "entry_points", lambda: points)


def test_another_package_adds_a_model_by_an_entry_point(monkeypatch: pytest.MonkeyPatch) -> None:
    entry_points(monkeypatch, "scex_sumo.behaviors.models.simple:ConstantVelocityProfile")
    assert "installed" in known_names()
    spec = ModelSpec(name="installed", parameters={"path": "3"})
    # Any callable may stand there; this one makes no model, which is noticed when it is built.
    with pytest.raises(UsageError, match="installed: ConstantVelocityProfile has neither plan nor plan_one"):
        build(spec)


def test_entry_points_of_a_group_are_selected_once(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = list[str]()

    class Points:
        def select(self, *, group: str) -> list[importlib.metadata.EntryPoint]:
            asked.append(group)
            return []

    points = Points()
    monkeypatch.setattr(importlib.metadata, "entry_points", lambda: points)
    kinds = [Registry(group=f"scex_sumo.{name}", kind=name) for name in ("behaviors", "worlds")]
    assert [kind.paths for kind in kinds * 3] == [{}] * 6
    assert asked == ["scex_sumo.behaviors", "scex_sumo.worlds"]


@pytest.mark.usefixtures("registered_models")
def test_names_that_are_taken_or_cannot_be_written_are_refused() -> None:
    for name in ("standard_driver", "graph_predictor", "sumo"):
        with pytest.raises(UsageError, match="belongs to a built-in model"):
            behavior(name)(Parked)
    for name in ("", "my driver", "a:b", "a@2", "a,b"):
        with pytest.raises(UsageError, match="a name must not contain"):
            behavior(name)(Parked)


class Drift:
    """Moves a metre sideways per step, one vehicle at a time."""

    def __init__(self) -> None:
        self.seen: list[tuple[int, int, int]] = []

    def plan_one(
        self, history: SceneHistory, road: Road, future: int, vehicle: int, rng: np.random.Generator
    ) -> States:
        self.seen.append((future, vehicle, len(road.lanes)))
        now, ahead = history.now[future, vehicle], np.arange(1, 31)
        return States(
            x=np.full(30, float(now.x)),
            y=float(now.y) + ahead + rng.integers(0, 1),
            heading=np.full(30, float(now.heading)),
            speed=np.full(30, 10.0),
        )


@pytest.mark.usefixtures("registered_models")
def test_a_model_for_one_vehicle_plans_for_each_in_turn_and_sees_the_whole_road() -> None:
    behavior("drift")(Drift)
    built = build(parse_models("drift")[0])
    assert isinstance(built, SingleVehicle)
    scene = roads.scene_of((10.0, 0.0, 0.0, 5.0), (60.0, 0.0, 0.0, 5.0))
    made = roads.plan(built, roads.fork(), roads.present(scene, 2))
    assert made.y == pytest.approx(np.repeat(np.arange(1.0, 31.0)[None], 4, axis=0))
    assert built.model.seen == [(0, 0, 4), (0, 1, 4), (0, 0, 4), (0, 1, 4)]  # type: ignore[attr-defined]


class FromFile:
    """Has a file among its parameters."""

    def __init__(self, *, path: str = "model.bin", also: str = "") -> None:
        self.path = path

    def plan(
        self, history: SceneHistory, road: Road, vehicles: VehicleIndex, rng: Sequence[np.random.Generator]
    ) -> Plan:
        raise NotImplementedError


@pytest.mark.usefixtures("registered_models")
def test_a_path_of_ones_own_model_may_be_a_file() -> None:
    behavior("from_file")(FromFile)
    assert build(parse_models("from_file:path=weights/other.bin")[0]).path == "weights/other.bin"  # type: ignore[attr-defined]


def straight_on(history: np.ndarray, *, factor: float = 1.0) -> np.ndarray:
    """Keeps speed and heading."""
    way = factor * 0.1 * history[:, -1, 4:] * np.arange(1, 31)
    return np.stack([way, np.zeros_like(way)], axis=-1)


def test_classes_functions_and_objects_are_models_with_a_readable_name() -> None:
    given = [Parked, Parked(steps=40), Predictor(straight_on), partial(straight_on, factor=0.5), "replay@2"]
    specs = model_specs(given)
    assert [str(spec) for spec in specs] == [
        "Parked", "Parked:steps=40", "straight_on", "straight_on:factor=0.5", "replay"
    ]  # fmt: skip
    assert [is_own(spec) for spec in specs] == [True, True, True, True, False]
    parked, kept, *predictors, _ = (build(spec) for spec in specs)
    assert isinstance(parked, Parked) and kept is given[1]
    assert all(isinstance(predictor, Predictor) for predictor in predictors)
    named = ModelSpec(name="slow", model=Drift(), weight=3.0, parameters={"guard": "true"})
    assert model_specs(named) == (named,) and str(named) == "slow:guard=true"


@pytest.mark.parametrize("given", [7, None, object(), {"name": "replay"}, np.zeros(2), ["replay", 7]])
def test_what_is_no_model_is_refused_in_one_line(given: object) -> None:
    with pytest.raises(UsageError, match=r"^got .* as a model; give its name, .* or a function of history$"):
        model_specs(given)
