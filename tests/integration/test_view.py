"""What sumo-gui shows of a future is what was logged: here plain sumo replays it, without a window."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from xml.etree import ElementTree

import numpy as np
import pytest
import sumo

from scex_sumo.scene import SeedScene, States
from scex_sumo.views.replay import FutureView, write_view
from tests.formats.sumo.simulations import in_sumo, write_grid
from tests.seeds import people_of, seed_of

STEPS = 40
MODELS = ("standard_driver", "sumo:EIDM:tau=1.2")
COLORS = {"standard_driver": (54, 124, 196), "sumo:EIDM:tau=1.2": (150, 110, 70)}


def tracks(shift: float) -> States:
    """(4, 40): through the junction, around it, across the fields, and standing on one another's place."""
    t = 0.1 * np.arange(STEPS)
    s = States.empty((4, STEPS))
    s.x[0], s.y[0], s.heading[0], s.speed[0] = 960 + shift + 12 * t, 998.4, 0.0, 12.0
    angle = 0.5 * t + shift
    s.x[1], s.y[1] = 1000 + 20 * np.cos(angle), 1000 + 20 * np.sin(angle)
    s.heading[1], s.speed[1] = angle + np.pi / 2, 10.0
    s.x[2], s.y[2], s.heading[2], s.speed[2] = 1060 + 9 * t, 1060 + 9 * t, np.pi / 4, 9 * np.sqrt(2)
    s.x[3], s.y[3], s.heading[3], s.speed[3] = 962.0, 998.0, 0.2, 0.0
    return s


def scene() -> SeedScene:
    """Four vehicles, and somebody who walks from frame 3 to frame 20."""
    states, walk = tracks(0.0), States.empty((1, 11 + 30))
    walk.x[0], walk.y[0] = 1010 + 0.13 * np.arange(41), 1012.0
    walk.heading[0], walk.speed[0] = 0.0, 1.3
    present = np.zeros((1, 41), dtype=bool)
    present[0, 3:21] = True
    present[0, 7] = False  # lost from sight for a moment: shown all the same
    return seed_of(
        states[:, :11],
        track_ids=np.array([3, 12, 7, 1]),
        types=("car", "truck", "bus", "motorcycle"),
        length=np.array([4.5, 12.0, 11.0, 2.2]),
        width=np.array([1.8, 2.5, 2.5, 0.8]),
        obstacles=people_of(walk, "pedestrian", present=present),
    )


def future(number: int, shift: float = 0.0) -> FutureView:
    models = [MODELS[(number + v) % 2] for v in range(4)]
    return FutureView(number=number, states=tracks(shift), models=models, title="wttc, 0.26 s")


def replay(configuration: Path) -> dict[str, dict[int, tuple[float, ...]]]:
    """What sumo makes of it: x, y, angle, speed by id and frame."""
    out = configuration.with_suffix(".out.xml")
    command = [str(Path(sumo.SUMO_HOME) / "bin" / "sumo"), "-c", configuration.name, "--precision", "9"]
    subprocess.run(
        [*command, "--fcd-output", out.name],
        cwd=configuration.parent,
        check=True,
        capture_output=True,
        timeout=60,
    )
    seen: dict[str, dict[int, tuple[float, ...]]] = {}
    for step in ElementTree.parse(out).getroot():
        for v in step:
            frame = round(10 * float(step.get("time", "nan")))
            values = tuple(float(v.get(key, "nan")) for key in ("x", "y", "angle", "speed"))
            seen.setdefault(v.get("id", ""), {})[frame] = values
    return seen


def agree(seen: dict[int, tuple[float, ...]], states: States, length: float) -> None:
    """All frames are there, and those after the first, in which SUMO inserts a vehicle, are exact.

    What SUMO does after the last one, where sumo-gui pauses, is of no interest.
    """
    assert sorted(seen)[:STEPS] == list(range(1, STEPS + 1))
    x = states.x + length / 2 * np.cos(states.heading)
    y = states.y + length / 2 * np.sin(states.heading)
    angle = np.mod(90 - np.degrees(states.heading), 360)
    expected = np.stack([x, y, angle, states.speed], axis=1)
    actual = np.array([seen[frame] for frame in range(1, STEPS + 1)])
    # The file has six decimals.
    np.testing.assert_allclose(actual[1:], expected[1:], rtol=0, atol=1e-6)


def test_futures_are_replayed_side_by_side(crossing: SimpleNamespace, tmp_path: Path) -> None:
    futures = [future(n, shift) for n, shift in ((4, 0.0), (8, 1.0), (15, 2.0))]
    configuration = write_view(tmp_path, crossing, scene(), futures, COLORS)
    assert configuration.name == "grid_3.sumocfg"
    seen = replay(configuration)
    assert len(seen) == 3 * 5
    starts = np.array([seen[f"t{slot}_3"][2][:2] for slot in range(3)])
    own = np.array([(c.states.x[0, 1], c.states.y[0, 1]) for c in futures])
    (across, up), (right, under) = np.rint((starts - own) - (starts - own)[0])[1:].tolist()
    assert (up, right) == (0, 0)
    down = -under
    # Vehicles reach over 137.1 m and 115.1 m: two columns as wide as the window is for both rows, 1.6 to 1.
    assert across > 180 and down < 180
    for slot, (dx, dy) in enumerate(((0, 0), (across, 0), (0, -down))):
        for v, key in enumerate(("3", "12", "7", "1")):
            states = futures[slot].states[v]
            moved = States(x=states.x + dx, y=states.y + dy, heading=states.heading, speed=states.speed)
            agree(seen[f"t{slot}_{key}"], moved, float(scene().length[v]))


@pytest.mark.parametrize("numbers", [(3,), (3, 5)])
def test_lights_are_replayed_at_the_times_of_the_vehicles(tmp_path: Path, numbers: tuple[int, ...]) -> None:
    net = write_grid(tmp_path).net
    read = ElementTree.parse(net)
    for light in read.iter("tlLogic"):
        light.set("offset", "-41.5")
    read.write(net)
    shown = SimpleNamespace(path=net, extras=None)
    configuration = write_view(tmp_path, shown, scene(), [future(n, -900.0) for n in numbers], COLORS)
    in_run = in_sumo(net, 0.1, steps=30).lights  # a future begins at 0.1 s
    in_replay = in_sumo(configuration, 1.0, steps=30).lights  # the tenth frame is the seed scene
    in_replay = {name.removeprefix("t0_"): states for name, states in in_replay.items()}
    here = [name for name in in_run if name in in_replay]  # a grid of futures is cut out
    assert len({state for name in here for state in in_run[name]}) > len(here)
    assert [in_replay[name] for name in here] == [in_run[name] for name in here]


def test_sumos_own_tool_plots_a_future(crossing: SimpleNamespace, tmp_path: Path) -> None:
    write_view(tmp_path, crossing, scene(), [future(0)], COLORS)
    code = (
        "import plot_trajectories as tool\n"
        "for kind in ('td', 'ds', 'xy'):\n"
        "    tool.main(tool.getOptions(['-t', kind, '-o', f'{kind}.png', '--blind', 'future_0000.fcd.xml']))"
    )
    command, home = [sys.executable, "-c", code], sumo.SUMO_HOME
    env = {"SUMO_HOME": home, "PYTHONPATH": f"{home}/tools", "MPLBACKEND": "agg", "HOME": str(tmp_path)}
    subprocess.run(command, cwd=tmp_path, check=True, capture_output=True, env=env, timeout=120)
    for kind in ("td", "ds", "xy"):
        assert (tmp_path / f"{kind}.png").read_bytes().startswith(b"\x89PNG")
