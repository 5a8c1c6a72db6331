"""What scenarios of other tools rely on: the order of things, edges, defaults and limits."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from scex_sumo.base.errors import InputError
from scex_sumo.converters.tracks.rows import TrackRows
from scex_sumo.scenarios.seeds import read_seed
from tests.formats.openscenario.scenarios import (
    CAR,
    WIDTH,
    after,
    at,
    axle,
    begins,
    event,
    of,
    scenario,
    set_speed,
    story,
    tag,
    time,
    track,
)

NEAR = {"abs": 0.05}
TWO = begins("Ego", at(-1, 50), 20) + begins("Other", at(-2, 100), 10)


def turned(lane: int, s: float, heading: float) -> str:
    """Position on a lane, turned from the direction in which it is driven."""
    turn = tag("Orientation", type="relative", h=heading)
    return tag("Position", tag("LanePosition", turn, roadId=7, laneId=lane, s=s))


def test_an_edge_needs_a_change_since_the_first_look(tmp_path: Path) -> None:
    """50 m apart at first, below 30 m from 2 s on, above from 8 s on."""
    kind = {"relativeDistanceType": "longitudinal", "freespace": "false", "rule": "greaterThan"}
    apart = of("Ego", tag("RelativeDistanceCondition", entityRef="Other", value=30, **kind))
    brake = event("brake", set_speed(0), after(apart, "rising"))
    rows, _ = track(scenario(tmp_path, TWO, story("Other", brake)), "2")
    assert axle(rows, 12)[::2] == pytest.approx((100 + 10 * 8, 0), **NEAR)


def test_a_heading_is_relative_to_the_lane_as_it_is_driven(tmp_path: Path) -> None:
    init = begins("Ego", turned(1, 100, math.pi), 10) + begins("Other", turned(1, 500, 0.0), 10)
    file = scenario(tmp_path, init)
    assert axle(track(file)[0], 2) == pytest.approx((120, WIDTH / 2, 10), **NEAR)
    assert axle(track(file, "2")[0], 2) == pytest.approx((480, WIDTH / 2, 10), **NEAR)


def test_first_positions_may_name_a_vehicle_that_comes_later(tmp_path: Path) -> None:
    behind = tag("Position", tag("RelativeLanePosition", entityRef="Other", dLane=1, ds=-30))
    rows, _ = track(scenario(tmp_path, begins("Ego", behind, 20) + begins("Other", at(-2, 100), 10)))
    assert axle(rows, 1) == pytest.approx((90, -WIDTH / 2, 20), **NEAR)


def test_a_controller_that_drives_from_the_start_leaves_the_first_moment(tmp_path: Path) -> None:
    controller = tag("ObjectController", tag("Controller", name="acc"))
    on = tag("ActivateControllerAction", longitudinal="true", lateral="true")
    private = "".join(
        tag("PrivateAction", one) for one in (f"<TeleportAction>{at(-1, 50)}</TeleportAction>", on)
    )
    ego = tag("Private", private, tag("PrivateAction", set_speed(20)), entityRef="Ego")
    init = ego + begins("Other", turned(1, 100, math.pi), 10)
    file = scenario(tmp_path, init, entities={"Ego": CAR + controller, "Other": CAR})
    scene = read_seed(file, time=0.0)
    assert scene.now.speed == pytest.approx([20, 10])  # the one against its lane is not parked
    assert track(file)[1][0] == "the scenario is known until 0 s: a controller drives Ego from then on"
    with pytest.raises(
        InputError, match=r"spans 0\.0 to 0\.0 s \(the scenario .* drives Ego from then on\); "
    ):
        read_seed(file, time=1.0)


def test_a_final_speed_is_relative_to_the_master(tmp_path: Path) -> None:
    """Ego needs 15 s for 300 m; Other has 240 m, and 20 - 4 m/s there."""
    lanes = [tag("LanePosition", roadId=7, laneId=lane, s=s) for lane, s in ((-1, 350), (-2, 340))]
    goals = [tag(f"TargetPosition{who}", lane) for who, lane in zip(("Master", ""), lanes, strict=True)]
    final = tag("FinalSpeed", tag("RelativeSpeedToMaster", speedTargetValueType="delta", value=-4))
    arrive = event("arrive", tag("SynchronizeAction", *goals, final, masterEntityRef="Ego"), after(time(0)))
    rows, _ = track(scenario(tmp_path, TWO, story("Other", arrive), stop_s=18), "2")
    assert axle(rows, 15.0)[::2] == pytest.approx((340, 16), **NEAR)


def follower(folder: Path, gap_m: float, **limits: float) -> tuple[TrackRows, TrackRows]:
    """Ego with 20 m/s, so far behind Other with 10 m/s, which wants 20 m."""
    inside = tag("DynamicConstraints", **limits) if limits else ""
    keep = {"entityRef": "Other", "distance": 20, "freespace": "false", "continuous": "true"}
    action = tag("LongitudinalAction", tag("LongitudinalDistanceAction", inside, **keep))
    init = begins("Ego", at(-2, 200 - gap_m), 20) + begins("Other", at(-2, 200), 10)
    file = scenario(folder, init, story("Ego", event("follow", action, after(time(0)))))
    return track(file)[0], track(file, "2")[0]


def test_a_follower_keeps_its_limits(tmp_path: Path) -> None:
    ego, _ = follower(tmp_path, 120, maxAcceleration=1, maxSpeed=22)
    assert [axle(ego, t)[2] for t in (1, 3)] == pytest.approx([21, 22], **NEAR)
    ego, _ = follower(tmp_path, 20, maxDeceleration=2)
    assert axle(ego, 2)[2] == pytest.approx(16, **NEAR)


def test_a_follower_without_limits_has_no_inertia(tmp_path: Path) -> None:
    """Of 2 m too many, 1 / e are left after each second."""
    ego, other = follower(tmp_path, 22)
    for t in (0.5, 2.0, 4.0):
        assert axle(ego, t)[2] == pytest.approx(10 + 2 * math.exp(-t), **NEAR)
        assert axle(other, t)[0] - axle(ego, t)[0] == pytest.approx(20 + 2 * math.exp(-t), **NEAR)


def test_offsets_may_be_left_out_and_truth_be_written_as_in_python(tmp_path: Path) -> None:
    same = tag("Position", tag("RelativeObjectPosition", entityRef="Ego", dx=5))
    target = tag(
        "RelativeTargetSpeed", entityRef="Ego", value=2, speedTargetValueType="factor", continuous="True"
    )
    faster = event("faster", set_speed(30), after(time(2)))
    file = scenario(
        tmp_path, begins("Ego", at(-1, 50), 10) + begins("Other", same, target), story("Ego", faster)
    )
    assert [axle(track(file, "2")[0], t)[2] for t in (1, 3)] == pytest.approx([20, 60])
    assert axle(track(file, "2")[0], 0)[:2] == pytest.approx((55, -WIDTH / 2), **NEAR)


def test_an_entry_of_a_catalog_knows_the_scenarios_parameters_but_has_its_own_first(tmp_path: Path) -> None:
    (tmp_path / "moves").mkdir()
    own = tag("ParameterDeclarations", tag("ParameterDeclaration", name="goal", value=5))
    slower = event("slower", set_speed("$goal", "linear", "rate", "$rate"), after(time(1)))  # type: ignore[arg-type]
    catalog = tag("OpenSCENARIO", tag("Catalog", tag("Maneuver", own, slower, name="slow"), name="Moves"))
    (tmp_path / "moves" / "Moves.xosc").write_text(catalog)
    head = tag("CatalogLocations", tag("ManeuverCatalog", tag("Directory", path="moves")))
    declared = "".join(tag("ParameterDeclaration", name=n, value=v) for n, v in (("goal", 9), ("rate", 2)))
    file = scenario(tmp_path, TWO, story("Other"), declared=declared, head=head)
    maneuver = '<Maneuver name="Other maneuver"></Maneuver>'
    refer = tag("CatalogReference", catalogName="Moves", entryName="slow")
    file.write_text(file.read_text().replace(maneuver, refer))
    assert [axle(track(file, "2")[0], t)[2] for t in (2, 5)] == pytest.approx([8, 5], **NEAR)


def test_a_collision_and_the_end_of_the_road_are_conditions(tmp_path: Path) -> None:
    """Boxes of 4.6 m meet when 50 m are 4.6 m; the road's end only matters to what has come to it."""
    hit = of("Ego", tag("CollisionCondition", tag("EntityRef", entityRef="Other")))
    end = of("Ego", tag("EndOfRoadCondition", duration=2))
    init = begins("Ego", at(-2, 50), 20) + begins("Other", at(-2, 100), 10)
    stories = story("Other", event("stop", set_speed(0), after(hit))) + story(
        "Ego", event("back", f"<TeleportAction>{at(-1, 5)}</TeleportAction>", after(end))
    )
    file = scenario(tmp_path, init, stories, stop_s=90)
    rows, notes = track(file, "2")
    assert axle(rows, 9)[0] == pytest.approx(100 + 10 * 4.54, **NEAR)
    assert notes[0].endswith("a trigger waits for a EndOfRoadCondition")
    assert np.max(track(file)[0].x) == pytest.approx(1000, abs=3)
