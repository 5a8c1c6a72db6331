"""Motion of OpenSCENARIO's actions against their arithmetic."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from scex_sumo.base.errors import InputError
from scex_sumo.scenarios.seeds import read_seed
from tests.formats.openscenario.scenarios import (
    AHEAD,
    CAR,
    WIDTH,
    after,
    at,
    axle,
    begins,
    change_lane,
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
TWO = begins("Ego", at(-1, 50), 20) + begins("Other", at(-2, 200), 10)
LEFT = '<RelativeTargetLane entityRef="Other" value="1"/>'


@pytest.mark.parametrize(
    ("shape", "dimension", "value", "duration"),
    [
        ("linear", "time", 4.0, 4.0),
        ("cubic", "time", 4.0, 4.0),
        ("sinusoidal", "time", 4.0, 4.0),
        ("linear", "rate", 2.5, 4.0),
        ("linear", "distance", 100.0, 4.0),
        ("cubic", "rate", 3.75, 4.0),
    ],
)
def test_a_change_of_speed_has_the_distance_of_its_shape(
    tmp_path: Path, shape: str, dimension: str, value: float, duration: float
) -> None:
    """From 20 to 30 m/s, from 2 s on: 25 m/s on average, whatever the shape."""
    faster = event("faster", set_speed(30, shape, dimension, value), after(time(2)))
    rows, _ = track(scenario(tmp_path, TWO, story("Ego", faster)))
    assert axle(rows, 2.0) == pytest.approx((90, -WIDTH / 2, 20), **NEAR)
    if shape == "linear":
        assert axle(rows, 2 + duration / 2)[0] == pytest.approx(90 + 22.5 * duration / 2, **NEAR)
    assert axle(rows, 2 + duration / 2)[2] == pytest.approx(25, **NEAR)
    assert axle(rows, 2 + duration)[::2] == pytest.approx((90 + 25 * duration, 30), **NEAR)
    assert axle(rows, 8.0)[0] == pytest.approx(190 + 30 * (6 - duration), **NEAR)


@pytest.mark.parametrize(
    ("shape", "quarter"), [("sinusoidal", (1 - math.sqrt(0.5)) / 2), ("cubic", 0.15625), ("linear", 0.25)]
)
def test_a_lane_change_has_its_shape_across(tmp_path: Path, shape: str, quarter: float) -> None:
    turn = event("turn", change_lane(LEFT, shape, 4.0), after(time(1)))
    rows, _ = track(scenario(tmp_path, TWO, story("Other", turn)), "2")
    for share, done in ((0.0, 0.0), (0.25, quarter), (0.5, 0.5), (0.75, 1 - quarter), (1.0, 1.0)):
        x, y, _ = axle(rows, 1 + 4 * share)
        assert (x, y) == pytest.approx((210 + 40 * share, -1.5 * WIDTH + WIDTH * done), **NEAR)
    assert rows.psi_rad[-1] == pytest.approx(0)


def test_a_lane_change_over_a_distance_and_to_a_lane_by_its_number(tmp_path: Path) -> None:
    lane = '<AbsoluteTargetLane value="-1"/>'
    turn = event("turn", change_lane(lane, "linear", 30.0, "distance"), after(time(1)))
    rows, _ = track(scenario(tmp_path, TWO, story("Other", turn)), "2")
    assert axle(rows, 2.5)[1] == pytest.approx(-WIDTH, **NEAR)
    assert axle(rows, 4.5)[1] == pytest.approx(-WIDTH / 2, **NEAR)


def test_the_left_of_oncoming_traffic_is_that_of_its_drivers(tmp_path: Path) -> None:
    init = begins("Ego", at(2, 900), 10) + begins("Other", at(-1, 100), 10)
    turn = event(
        "turn", change_lane('<RelativeTargetLane entityRef="Ego" value="1"/>', "linear", 2.0), after(time(1))
    )
    rows, _ = track(scenario(tmp_path, init, story("Ego", turn)))
    x, y, _ = axle(rows, 4.0)
    assert (x, y) == pytest.approx((860, WIDTH / 2), **NEAR)
    assert abs(rows.psi_rad[0]) == pytest.approx(math.pi)


def near(kind: str, name: str, value: float, *inner: str, **more: str) -> str:
    """Condition of Ego on its distance or time to another one."""
    given = {"value": value, "freespace": "false", "rule": "lessThan", **more}
    return of("Ego", tag(kind, *inner, **({"entityRef": name} if name else {}), **given))


OTHER = tag("TimeToCollisionConditionTarget", tag("EntityRef", entityRef="Other"))
LONG = {"relativeDistanceType": "longitudinal"}


@pytest.mark.parametrize(
    ("condition", "starts"),
    [
        # 150 m apart, Ego 10 m/s faster
        (near("TimeHeadwayCondition", "Other", 5), 5.0),
        (near("TimeToCollisionCondition", "", 8, OTHER), 15 - math.sqrt(80**2 - WIDTH**2) / 10),
        (near("RelativeDistanceCondition", "Other", 100, **LONG), 5.0),
        (near("RelativeDistanceCondition", "Other", 100, **{**LONG, "freespace": "true"}), 4.54),
        (of("Ego", tag("ReachPositionCondition", at(-1, 131), tolerance=1)), 4.0),
        (of("Ego", tag("TraveledDistanceCondition", value=60)), 3.0),
        (of("Other", tag("SpeedCondition", value=9, rule="greaterThan")), 0.0),
        (time(3, "greaterThan"), 3.0),
    ],
)
def test_triggers_fire_when_the_motion_says_so(tmp_path: Path, condition: str, starts: float) -> None:
    brake = event("brake", set_speed(0), after(condition))
    rows, _ = track(scenario(tmp_path, TWO, story("Other", brake), stop_s=9), "2")
    assert axle(rows, 8.9)[0] == pytest.approx(200 + 10 * starts, **NEAR)
    assert axle(rows, 8.9)[2] == 0


def test_a_place_between_two_steps_is_reached(tmp_path: Path) -> None:
    """At 50 m/s Ego is within .2 m of it for 8 ms, from 3.996 s on."""
    narrow = of("Ego", tag("ReachPositionCondition", at(-1, 250), tolerance=0.2))
    init = begins("Ego", at(-1, 50), 50) + begins("Other", at(-2, 200), 10)
    rows, _ = track(
        scenario(tmp_path, init, story("Other", event("brake", set_speed(0), after(narrow)))), "2"
    )
    assert axle(rows, 8.9)[::2] == pytest.approx((239.96, 0), **NEAR)


PLACE = tag("TimeToCollisionConditionTarget", at(-1, 151))


@pytest.mark.parametrize(
    ("condition", "starts"),
    [
        # Ego needs 101 m at 30 m/s, and 6 ms for .2 m.
        (near("DistanceCondition", "", 0.2, at(-1, 151)), 3.36),
        (near("RelativeDistanceCondition", "Other", 0.2, **LONG), 3.36),
        (near("TimeHeadwayCondition", "Other", 0.01), 3.357),
        (near("TimeToCollisionCondition", "", 0.01, PLACE), 3.357),
        (time(2.013, "equalTo"), 2.013),
    ],
)
def test_a_trigger_that_is_met_between_two_steps_fires(tmp_path: Path, condition: str, starts: float) -> None:
    init = begins("Ego", at(-1, 50), 30) + begins("Other", at(-2, 151), 0)
    away = story("Other", event("away", set_speed(7), after(condition)))
    rows, _ = track(scenario(tmp_path, init, away, stop_s=6), "2")
    assert axle(rows, 5.0)[::2] == pytest.approx((151 + 7 * (5 - starts), 7), **NEAR)


def test_a_headway_is_that_to_one_ahead_and_names_may_look_like_expressions(tmp_path: Path) -> None:
    """Other overtakes Ego: 25 m behind at first, 12 m ahead after 37 / 10 s."""
    headway = near("TimeHeadwayCondition", "Other", 0.6, rule="greaterThan", coordinateSystem="road")
    brake = event(
        "brake", set_speed(0), after(headway, "rising").replace('name="c"', 'name="${HWT + _ + 1}"')
    )
    init = begins("Ego", at(-1, 50), 20) + begins("Other", at(-2, 25), 30)
    rows, _ = track(scenario(tmp_path, init, story("Other", brake), stop_s=9), "2")
    assert axle(rows, 8.9)[0] == pytest.approx(25 + 30 * 3.7, **NEAR)


def test_events_follow_each_other_and_delays_are_kept(tmp_path: Path) -> None:
    of_event = {"storyboardElementType": "event", "storyboardElementRef": "first", "state": "completeState"}
    done = tag("ByValueCondition", tag("StoryboardElementStateCondition", **of_event))
    first = event("first", set_speed(20, "linear", "time", 2), after(time(1)))
    second = event("second", set_speed(0, "linear", "time", 2), after(done, "rising", 1.5))
    rows, _ = track(scenario(tmp_path, TWO, story("Other", first, second), stop_s=12), "2")
    speeds = [axle(rows, t)[2] for t in (1, 2, 3, 4.4, 5.5, 7)]
    assert speeds == pytest.approx([10, 15, 20, 20, 10, 0], **NEAR)


def test_parameters_expressions_and_catalogs_are_filled_in(tmp_path: Path) -> None:
    (tmp_path / "cars").mkdir()
    long = tag("ParameterDeclaration", name="long", parameterType="double", value=5)
    entry = CAR.replace("<BoundingBox", tag("ParameterDeclarations", long) + "<BoundingBox")
    entry = entry.replace('length="4.6"', 'length="$long"')
    catalog = f'<OpenSCENARIO><Catalog name="Cars">{entry}</Catalog></OpenSCENARIO>'
    (tmp_path / "cars" / "Cars.xosc").write_text(catalog)
    given = tag("ParameterAssignments", tag("ParameterAssignment", parameterRef="long", value=6.5))
    head = tag("CatalogLocations", tag("VehicleCatalog", tag("Directory", path="cars")))
    refer = '<CatalogReference catalogName="Cars" entryName="car">{}</CatalogReference>'
    declared = '<ParameterDeclaration name="$v" parameterType="double" value="12"/>'  # as ASAM's examples do
    init = begins("Ego", at(-1, 50), "$v") + begins("Other", at(-2, 200), "${2 * $v - max(4, 1)}")
    entities = {"Ego": refer.format(given), "Other": refer.format("")}
    file = scenario(tmp_path, init, entities=entities, declared=declared, head=head)
    ego, other = track(file)[0], track(file, "2")[0]
    assert (ego.length[0], other.length[0]) == (6.5, 5.0)
    assert (axle(ego, 1)[2], axle(other, 1)[2]) == pytest.approx((12, 20))


def test_positions_relative_to_another_vehicle(tmp_path: Path) -> None:
    beside = '<Position><RelativeLanePosition entityRef="Ego" dLane="-1" ds="30" offset="0.5"/></Position>'
    rows, _ = track(scenario(tmp_path, begins("Ego", at(-1, 50), 20) + begins("Other", beside, 5)), "2")
    assert axle(rows, 0) == pytest.approx((80, -1.5 * WIDTH + 0.5, 5), **NEAR)
    behind = '<Position><RelativeLanePosition entityRef="Ego" dLane="1" ds="-30"/></Position>'
    rows, _ = track(scenario(tmp_path, begins("Ego", at(-2, 50), 20) + begins("Other", behind, 5)), "2")
    assert axle(rows, 1) == pytest.approx((25, -WIDTH / 2, 5), **NEAR)
    ahead = '<Position><RelativeObjectPosition entityRef="Ego" dx="10" dy="2"/></Position>'
    rows, _ = track(scenario(tmp_path, begins("Ego", at(1, 500), 0) + begins("Other", ahead, 0)), "2")
    assert axle(rows, 0)[:2] == pytest.approx((490, WIDTH / 2 - 2), **NEAR)


def test_a_position_on_a_route_is_that_far_from_its_first_place(tmp_path: Path) -> None:
    waypoints = "".join(tag("Waypoint", at(-1, s), routeStrategy="shortest") for s in (20, 400))
    inside = tag("InRoutePosition", tag("FromLaneCoordinates", pathS=60, laneId=-1))
    route = tag("RouteRef", tag("Route", waypoints, name="r", closed="false"))
    init = begins("Ego", tag("Position", tag("RoutePosition", route, inside)), 20) + begins(
        "Other", at(-2, 9), 0
    )
    assert axle(track(scenario(tmp_path, init))[0], 1) == pytest.approx((100, -WIDTH / 2, 20), **NEAR)


def follow(shape: str, timing: str = "") -> str:
    line = tag("TrajectoryRef", tag("Trajectory", tag("Shape", shape), name="t", closed="false"))
    mode = tag("TrajectoryFollowingMode", followingMode="position")
    times = tag("TimeReference", timing or "<None/>")
    return tag("RoutingAction", tag("FollowTrajectoryAction", line, times, mode))


def test_a_trajectory_is_followed_by_its_times_or_by_the_own_speed(tmp_path: Path) -> None:
    points = [(0.0, 100.0, -5.0), (2.0, 120.0, -5.0), (4.0, 120.0, 15.0)]
    vertices = "".join(
        tag("Vertex", tag("Position", tag("WorldPosition", x=x, y=y)), time=t) for t, x, y in points
    )
    line = f"<Polyline>{vertices}</Polyline>"
    timing = '<Timing domainAbsoluteRelative="relative" scale="2" offset="0"/>'
    timed = event("timed", follow(line, timing), after(time(1)))
    rows, _ = track(scenario(tmp_path, TWO, story("Other", timed)), "2")
    assert axle(rows, 3.0)[:2] == pytest.approx((110, -5), **NEAR)
    assert axle(rows, 7.0)[:2] == pytest.approx((120, 5), **NEAR)
    free = event("free", follow(line), after(time(1)))
    rows, _ = track(scenario(tmp_path, TWO, story("Other", free)), "2")
    assert axle(rows, 2.0)[0] == pytest.approx(110, **NEAR)


TELEPORT = tag("TeleportAction", at(-2, 300))
ROUTE = tag("RoutingAction", tag("AcquirePositionAction", at(-1, 900)))


@pytest.mark.parametrize(("action", "x", "lane"), [(TELEPORT, 340, -2), (ROUTE, 150, -1)])
def test_one_that_is_put_elsewhere_leaves_its_trajectory(
    tmp_path: Path, action: str, x: float, lane: int
) -> None:
    """It comes to x = 110 m with 20 m/s in 3 s, and is elsewhere, or on its route, from then on."""
    places = (tag("Position", tag("WorldPosition", x=x, y=-WIDTH / 2)) for x in (70, 270))
    line = "".join(tag("Vertex", place, time=t) for place, t in zip(places, (0, 10), strict=True))
    timing = '<Timing domainAbsoluteRelative="relative" scale="1" offset="0"/>'
    along = event("along", follow(tag("Polyline", line), timing), after(time(1)))
    put = event("put", action, after(time(3)), "parallel")
    rows, _ = track(scenario(tmp_path, TWO, story("Ego", along, put), stop_s=6))
    assert axle(rows, 5.0) == pytest.approx((x, (lane + 0.5) * WIDTH, 20), **NEAR)


def test_one_drives_on_from_the_end_of_its_trajectory(tmp_path: Path) -> None:
    """At 20 m/s it is at the end, x = 110.7 m, after 3.035 s."""
    places = (tag("Position", tag("WorldPosition", x=x, y=-WIDTH / 2)) for x in (70, 110.7))
    line = tag("Polyline", *(tag("Vertex", place) for place in places))
    rows, _ = track(scenario(tmp_path, TWO, story("Ego", event("along", follow(line), after(time(1))))))
    assert axle(rows, 5.0) == pytest.approx((150, -WIDTH / 2, 20), **NEAR)


@pytest.mark.parametrize(("one", "other"), [("Ego", "Other"), ("Other", "Ego")])
def test_a_speed_relative_to_one_that_changes_its_own_is_that_of_the_same_time(
    tmp_path: Path, one: str, other: str
) -> None:
    """From 1 s on both have one speed: 10 m/s, from 2 s on 2.5 m/s² more for 8 s."""
    init = begins(one, at(-1, 50), 10) + begins(other, at(-2, 200), 10)
    target = tag("RelativeTargetSpeed", entityRef=other, value=0, continuous="true")
    same = story(one, event("same", set_speed(target), after(time(1))))
    faster = story(other, event("faster", set_speed(30, "linear", "time", 8), after(time(2))))
    rows, _ = track(scenario(tmp_path, init, same + faster), "1" if one == "Ego" else "2")
    assert axle(rows, 10.0)[::2] == pytest.approx((50 + 10 * 10 + 2.5 * 8**2 / 2, 30), **NEAR)


def test_a_clothoid_of_constant_curvature_is_a_circle(tmp_path: Path) -> None:
    start = tag("Position", tag("WorldPosition", x=300, y=-20, h=0))
    arc = tag("Clothoid", start, curvature=0.02, curvaturePrime=0, length=25 * math.pi)
    turn = event("turn", follow(arc), after(time(0)))
    rows, _ = track(scenario(tmp_path, TWO, story("Other", turn), stop_s=7), "2")
    for t in (2.0, 4.0, 6.0):
        angle = 10 * t / 50
        x, y, _ = axle(rows, t)
        assert (x, y) == pytest.approx((300 + 50 * math.sin(angle), -20 + 50 * (1 - math.cos(angle))), **NEAR)


def test_two_arrive_at_the_same_time(tmp_path: Path) -> None:
    """Ego needs 15 s for 300 m; Other has 140 m, and 12 m/s there."""
    lanes = [tag("LanePosition", roadId=7, laneId=lane, s=s) for lane, s in ((-1, 350), (-2, 340))]
    names = "TargetPositionMaster", "TargetPosition"
    goals = [tag(name, lane) for name, lane in zip(names, lanes, strict=True)]
    final = tag("FinalSpeed", tag("AbsoluteSpeed", value=12))
    action = tag("SynchronizeAction", *goals, final, masterEntityRef="Ego")
    arrive = event("arrive", action, after(time(0)))
    rows, _ = track(scenario(tmp_path, TWO, story("Other", arrive), stop_s=18), "2")
    assert axle(rows, 15.0)[::2] == pytest.approx((340, 12), **NEAR)


def test_a_follower_comes_to_its_distance(tmp_path: Path) -> None:
    gap = {"entityRef": "Other", "distance": 20, "freespace": "true", "continuous": "true"}
    action = tag("LongitudinalAction", tag("LongitudinalDistanceAction", **gap))
    init = begins("Ego", at(-2, 100), 20) + begins("Other", at(-2, 200), 10)
    file = scenario(tmp_path, init, story("Ego", event("follow", action, after(time(0)))), stop_s=25)
    ego, other = track(file)[0], track(file, "2")[0]
    assert axle(other, 24)[0] - axle(ego, 24)[0] == pytest.approx(20 + 4.6, **NEAR)
    assert axle(ego, 24)[2] == pytest.approx(10, **NEAR)


def test_a_moment_of_a_scenario_is_a_seed_scene_with_its_names(tmp_path: Path) -> None:
    turn = event(
        "turn", change_lane(LEFT, "sinusoidal", 3.0), after(near("TimeHeadwayCondition", "Other", 6))
    )
    file = scenario(tmp_path, TWO, story("Other", turn))
    scene = read_seed(file, time=4.0)
    assert scene.road is not None and scene.vehicles == 2
    assert scene.source["vehicles"] == {"1": "Ego", "2": "Other"}
    assert scene.now.x == pytest.approx([130 + AHEAD, 240 + AHEAD], abs=0.05)
    assert scene.recorded_steps.min() == 10


def test_road_users_that_are_added_and_deleted_come_and_go(tmp_path: Path) -> None:
    """As our own exports say that a vehicle leaves."""

    def change(body: str, seconds: float) -> str:
        action = tag("GlobalAction", tag("EntityAction", body, entityRef="Other"))
        event = f'<Event name="e{seconds}" priority="parallel"><Action name="a">{action}</Action>'
        return f"{event}{after(time(seconds))}</Event>"

    changes = change(tag("DeleteEntityAction"), 3), change(tag("AddEntityAction", at(-1, 300)), 5)
    file = scenario(tmp_path, TWO, story("Ego", *changes), stop_s=9)
    rows, notes = track(file, "2")
    assert not notes
    assert not ((rows.timestamp_ms > 3050) & (rows.timestamp_ms < 4950)).any()
    assert axle(rows, 8)[:2] == pytest.approx((330, -WIDTH / 2), **NEAR)
    assert axle(track(file)[0], 8)[0] == pytest.approx(50 + 20 * 8, **NEAR)


def test_the_distance_between_boxes_of_unknown_size_is_unknown(tmp_path: Path) -> None:
    free = {"relativeDistanceType": "euclidianDistance", "freespace": "true", "rule": "lessThan"}
    brake = event("brake", set_speed(0), after(near("RelativeDistanceCondition", "Other", 500, **free)))
    entities = dict.fromkeys(("Ego", "Other"), '<Vehicle name="car" vehicleCategory="car"/>')
    rows, _ = track(scenario(tmp_path, TWO, story("Ego", brake), entities=entities, stop_s=4))
    assert rows.speed.min() == pytest.approx(20)


@pytest.mark.parametrize(("state", "speed"), [("endTransition", 10), ("stopTransition", 5)])
def test_an_event_that_another_one_overrides_is_stopped_and_has_not_ended(
    tmp_path: Path, state: str, speed: float
) -> None:
    waits = (
        '<ByValueCondition><StoryboardElementStateCondition storyboardElementType="event" '
        f'storyboardElementRef="first" state="{state}"/></ByValueCondition>'
    )
    first = event("first", set_speed(30, "linear", "time", 5), after(time(1)))
    second = event("second", change_lane(LEFT, "linear", 2), after(time(2)))
    others = story("Other", event("brake", set_speed(5), after(waits)))
    file = scenario(tmp_path, TWO, story("Ego", first, second) + others, stop_s=5)
    assert axle(track(file, "2")[0], 4)[2] == speed


@pytest.mark.parametrize("stop_s", [1.999, 2.0, 2.001, 2.002])
def test_an_act_that_is_stopped_repeats_no_event(tmp_path: Path, stop_s: float) -> None:
    faster = set_speed('<RelativeTargetSpeed entityRef="Ego" value="10"/>', "linear", "time", 1)
    twice = event("twice", faster, after(time(1))).replace("<Event", '<Event maximumExecutionCount="2"')
    stop = after(time(stop_s), "rising").replace("StartTrigger", "StopTrigger")
    stories = story("Ego", twice).replace("</Act>", f"{stop}</Act>")
    assert axle(track(scenario(tmp_path, TWO, stories, stop_s=6))[0], 5)[2] == pytest.approx(30, **NEAR)


def test_what_a_controller_decides_is_not_known(tmp_path: Path) -> None:
    controlled = f'{CAR}<ObjectController><Controller name="acc"/></ObjectController>'
    act = (
        '<ControllerAction><ActivateControllerAction longitudinal="true" lateral="false"/></ControllerAction>'
    )
    file = scenario(
        tmp_path,
        TWO,
        story("Ego", event("drive", act, after(time(6)))),
        entities={"Ego": controlled, "Other": CAR},
    )
    rows, notes = track(file)
    assert rows.timestamp_ms.max() == 6000
    assert notes[0] == "the scenario is known until 6 s: a controller drives Ego from then on"
    with pytest.raises(InputError, match=r"spans 0\.0 to 6\.0 s"):
        read_seed(file, time=7.0)


def test_a_trigger_that_is_not_read_matters_only_if_all_others_hold(tmp_path: Path) -> None:
    light = '<ByValueCondition><TrafficSignalCondition name="1" state="green"/></ByValueCondition>'
    both = after(light).replace(
        "</ConditionGroup>", f'<Condition name="d">{time(5)}</Condition></ConditionGroup>'
    )
    rows, notes = track(scenario(tmp_path, TWO, story("Ego", event("go", set_speed(5), both))))
    assert rows.timestamp_ms.max() == 5000 and "a trigger waits for a TrafficSignalCondition" in notes[0]
