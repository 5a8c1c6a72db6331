"""The seed scene of a result is the one that was written, whatever a reader can produce."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from scex_sumo.converters.datasets.recordings import recorded_scene
from scex_sumo.converters.datasets.scene import take_scene
from scex_sumo.converters.datasets.writer import write_tracks
from scex_sumo.converters.tracks.road_users import MOTOR_TYPES
from scex_sumo.formats.samples.build import track_table
from scex_sumo.results.tables.states import read_scene
from scex_sumo.scene import Obstacles, SeedScene
from tests.converters.datasets.test_writer import same
from tests.formats.commonroad.test_tracks import eastbound, recorded

WORDS = st.one_of(
    st.sampled_from(["car", "vehicle", "pedestrian/bicycle", "Truck", "1", "7.0", " P1 ", "NaN", "a,b", '"']),
    st.text(max_size=6),
)


@st.composite
def scenes(draw: st.DrawFn) -> SeedScene:
    """Vehicles with numbers and others with any ids and types, some of them large and fast."""
    count, others = draw(st.integers(1, 3)), draw(st.integers(0, 4))
    numbers = draw(st.lists(st.integers(-(2**40), 2**40), min_size=count, max_size=count, unique=True))
    labels = [str(number) for number in numbers] + [draw(WORDS) for _ in range(others)]
    types = [draw(st.sampled_from(sorted(MOTOR_TYPES)) | WORDS) for _ in labels]
    number = st.floats(-1e5, 1e5)
    track, columns = [], []
    for k in range(len(labels)):
        first, last = draw(st.integers(0, 10 if k == 0 else 20)), draw(st.integers(21, 45))
        gap = set(range(30, 30 + draw(st.integers(0, 9)))) | set(range(13, 13 + draw(st.integers(0, 7))))
        steps = np.array([step for step in range(first, last) if step not in gap - {20}])
        x, y, heading = draw(number), draw(number), draw(st.floats(-4.0, 4.0))
        speed = draw(st.floats(0.0, 30.0))
        size = draw(st.floats(0.1, 20.0)), draw(st.floats(0.1, 4.0))
        way = 0.1 * speed * steps
        rows = [100.0 * steps, x + way * np.cos(heading), y + way * np.sin(heading)]
        rows += [
            np.full(len(steps), v) for v in (speed * np.cos(heading), speed * np.sin(heading), heading, *size)
        ]
        columns.append(np.array(rows))
        track += [k] * len(steps)
    names = ("timestamp_ms", "x", "y", "vx", "vy", "psi_rad", "length", "width")
    values = dict(zip(names, np.concatenate(columns, axis=1), strict=True))
    motor = np.array(track) < count
    table = track_table(Path("t.csv"), motor, np.array(track), labels, types, step_s=0.1, **values)
    return take_scene(table, name="s", location="", time_s=2.0, repair=False)


def written_and_read(scene: SeedScene, folder: Path) -> SeedScene:
    """The scene of a result; obstacles have no order."""
    write_tracks(folder / "seed.csv", scene)
    again = read_scene(folder, {"name": scene.name, "track_ids": scene.track_ids.tolist()})
    if (o := again.obstacles) is None or scene.obstacles is None:
        return again
    assert set(o.ids) == set(scene.obstacles.ids)
    order = [o.ids.index(name) for name in scene.obstacles.ids]
    named = {name: tuple(getattr(o, name)[k] for k in order) for name in ("ids", "types")}
    taken = {name: getattr(o, name)[order] for name in ("length", "width", "states", "present")}
    return replace(again, obstacles=Obstacles(**named, **taken))


@given(scenes())
@settings(max_examples=60, deadline=None)
def test_whatever_a_reader_can_produce_is_read_back_equal(scene: SeedScene) -> None:
    with TemporaryDirectory() as folder:
        same(scene, written_and_read(scene, Path(folder)))


def test_a_standing_obstacle_of_unknown_type_stays_an_obstacle(tmp_path: Path) -> None:
    """CommonRoad calls it `unknown`, which the reader takes for a vehicle if it moves."""
    path = recorded(tmp_path, [eastbound(1, 0.0, 10.0, range(30))])
    standing = (
        '<staticObstacle id="7"><type>unknown</type><shape><rectangle><length>4</length><width>2</width>'
        "</rectangle></shape><initialState><position><point><x>9</x><y>3</y></point></position><orientation>"
        "<exact>0</exact></orientation><time><exact>0</exact></time></initialState></staticObstacle>"
    )
    path.write_text(path.read_text().replace("</commonRoad>", f"{standing}</commonRoad>"))
    scene = recorded_scene(path, time_s=3.0)
    assert scene.obstacles is not None and scene.obstacles.ids == ("7",)
    same(scene, written_and_read(scene, tmp_path))
