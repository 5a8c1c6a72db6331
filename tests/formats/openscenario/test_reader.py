"""Round trips of our own exports, routes, logs of esmini, wrong and damaged files."""

from __future__ import annotations

import math
from pathlib import Path
from random import Random

import numpy as np
import pytest

from scex_sumo import extrapolate, open_run, read_seed
from scex_sumo.base.errors import ScexError
from scex_sumo.converters.datasets.find import find_recordings
from scex_sumo.exporters.command import export_command
from scex_sumo.scenarios import example_path
from tests.formats.openscenario.scenarios import (
    CAR,
    after,
    at,
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
from tests.fuzz.mutations import bytes_changed

TWO = begins("Ego", at(-1, 50), 20) + begins("Other", at(-2, 200), 10)


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A run of the roundabout, and its futures as OpenSCENARIO."""
    folder = tmp_path_factory.mktemp("exported")
    run, out = folder / "run", folder / "out"
    extrapolate(
        read_seed(example_path("roundabout")),
        futures=5,
        models="rules",
        reference=None,
        report=False,
        out=run,
    )
    export_command(run, every=True, to="openscenario", out=out)
    return run, out


def test_our_exports_come_back_as_the_same_moment(exported: tuple[Path, Path]) -> None:
    run = open_run(exported[0])
    for future, file in enumerate(sorted(exported[1].glob("*.xosc"))):
        scene, states = read_seed(file, time=0.9), run.states(future)
        known = run.info["seed_scene"]["track_ids"]
        states = states[[known.index(track) for track in scene.track_ids]]
        now, then, ahead = scene.now, states[:, 9], states[:, 10:40]
        assert np.hypot(now.x - then.x, now.y - then.y).max() < 1e-5
        assert np.abs(now.speed - then.speed).max() < 1e-4
        assert scene.future is not None and len(known) == scene.vehicles
        assert np.hypot(scene.future.x[:, :30] - ahead.x, scene.future.y[:, :30] - ahead.y).max() < 1e-5


def test_a_route_is_followed_through_junctions(exported: tuple[Path, Path], tmp_path: Path) -> None:
    """A vehicle sent to where one of an export came to passes there, though it knows no trajectory."""
    road = next(exported[1].glob("*.xodr"))
    (recording,) = find_recordings([next(exported[1].glob("*0000.xosc"))])
    scene = read_seed(recording.map_path, time=0.9)
    v = int(np.argmax(scene.now.speed))
    assert scene.future is not None
    places = [
        tag("Position", tag("WorldPosition", x=s.x[v], y=s.y[v], h=s.heading[v]))
        for s in (scene.now, scene.future[:, 29])
    ]
    route = tag("RoutingAction", tag("AcquirePositionAction", places[1]))
    file = scenario(tmp_path, begins("Ego", places[0], float(scene.now.speed[v]), route))
    file.write_text(file.read_text().replace("road.xodr", str(road)))
    rows, _ = track(file)
    goal = scene.future[v, 29]
    assert np.hypot(rows.x - goal.x, rows.y - goal.y).min() < 3.0


def test_a_log_of_esmini_is_a_recording(tmp_path: Path) -> None:
    names = (
        "Entitity_Name [-]",
        "Entitity_ID [-]",
        "Current_Speed [m/s]",
        "bb_x [m]",
        "bb_y [m]",
        "bb_length [m]",
    )
    names += ("bb_width [m]", "World_Position_X [m]", "World_Position_Y [m]", "World_Heading_Angle [rad]")
    head = ", ".join(
        ["Index [-] ", "TimeStamp [s] ", *(f"#{k} {name} " for k in (1, 2) for name in names), ""]
    )
    lines = ["Version: 2, OpenSCENARIO File: case.xosc, Vehicle Count: 2", head]
    for k in range(30):
        cars = [f"{who}, 0, 10, 1.4, 0, 5, 2, {x + k}, -5, 0" for who, x in (("Ego", 50), ("B", 90))]
        lines.append(f"{k}, {k / 10}, " + ", ".join(cars) + ", ")
    file = tmp_path / "log.csv"
    file.write_text("\n".join(lines))
    scene = read_seed(scenario(tmp_path, TWO), tracks=file, time=1.5)
    assert scene.now.x == pytest.approx([106.4, 66.4]) and scene.now.speed == pytest.approx([10, 10])
    assert scene.length == pytest.approx([5, 5])


WRONG = {
    "no XML": ("<OpenSCENARIO", "no", "not XML"),
    "another root": ("OpenSCENARIO", "OpenDRIVE", "no scenario of OpenSCENARIO"),
    "no road": ('filepath="road.xodr"', "", "no OpenDRIVE file"),
    "another road": ("road.xodr", "gone.xodr", "no such file"),
    "unknown parameter": ('value="20"', 'value="$fast"', "parameter fast is not declared"),
    "wrong expression": ('value="20"', 'value="${2 *}"', "AbsoluteTargetSpeed is '${2 *}'"),
    "unsafe expression": ('value="20"', "value=\"${__import__('os').getpid()}\"", "is \"${__import__('os'"),
    "no number": ('value="20"', 'value="fast"', "value of its AbsoluteTargetSpeed is 'fast'"),
    "unknown lane": ('laneId="-1"', 'laneId="-4"', "no lane -4"),
    "unknown road": ('roadId="7"', 'roadId="8"', "no road 8"),
    "unknown entity": ('entityRef="Ego"', 'entityRef="Nobody"', "'Nobody' is not there"),
    "unread position": ("LanePosition", "GeoPosition", "GeoPosition is not read"),
    "no box": ("Vehicle", "Horse", "is no vehicle"),
    "no catalog": (CAR, '<CatalogReference catalogName="C" entryName="e"/>', "entry e of catalog C"),
    "nobody": (TWO, "", "no box in it"),
    "unknown event": ('Ref="go"', 'Ref="went"', "'went' is not in its storyboard"),
    "unknown edge": (
        'conditionEdge="none"',
        'conditionEdge="sideways"',
        "conditionEdge of its Condition is 'sid",
    ),
    "unknown rule": (
        'rule="greaterOrEqual"',
        'rule="about"',
        "rule of its SimulationTimeCondition is 'about'",
    ),
    "no time": (' value="1" rule=', " rule=", "value of its SimulationTimeCondition is 'None'"),
    "unknown shape": (
        'dynamicsShape="step"',
        'dynamicsShape="bent"',
        "dynamicsShape of its SpeedActionDynam",
    ),
    "infinite speed": ('value="20"', 'value="1e300"', "1e+300"),
}


@pytest.mark.parametrize("case", WRONG)
def test_wrong_files_are_named_in_one_line(tmp_path: Path, case: str) -> None:
    old, new, words = WRONG[case]
    of_event = {"storyboardElementType": "event", "storyboardElementRef": "go", "state": "runningState"}
    started = tag("ByValueCondition", tag("StoryboardElementStateCondition", **of_event))
    stories = story(
        "Ego", event("go", set_speed(5), after(time(1))), event("stop", set_speed(0), after(started))
    )
    file = scenario(tmp_path, TWO, stories)
    file.write_text(file.read_text().replace(old, new))
    with pytest.raises(ScexError) as error:
        read_seed(file, time=2.0)
    assert words in str(error.value) and "\n" not in str(error.value) and str(file.parent) in str(error.value)


@pytest.mark.parametrize("seed", range(3))
def test_damaged_files_give_a_moment_or_one_line(tmp_path: Path, seed: int) -> None:
    rng = Random(seed)
    near = of("Ego", tag("ReachPositionCondition", at(-1, 80), tolerance=1))
    go = event("go", set_speed(5, "linear", "rate", 2), after(near))
    stop = event("stop", set_speed(0, "sinusoidal", "time", 2), after(time(1)))
    stories = story("Ego", go) + story("Other", stop)
    words = ("", "-1", "0", "nan", "1e300", "$x", "a" * 300, "99999999999999999999", "Other", "Ego")
    for _ in range(35):
        file = scenario(tmp_path, TWO, stories, stop_s=4)
        if rng.random() < 0.3:
            bytes_changed(file if rng.random() < 0.7 else tmp_path / "road.xodr", rng)
        else:
            parts = file.read_text().split('"')
            parts[2 * rng.randrange(len(parts) // 2) + 1] = rng.choice(words)
            file.write_text('"'.join(parts))
        try:
            scene = read_seed(file, time=2.0)
        except ScexError as error:
            assert "\n" not in str(error)
        else:
            assert math.isfinite(float(scene.now.x.sum()))
