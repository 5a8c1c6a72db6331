"""sumo-gui shows what libsumo computes. Needs an X server: Xvfb, where there is no screen."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import sumo
from matplotlib.image import imread

from scex_sumo.base.errors import SimulationError
from scex_sumo.scene import SeedScene, States
from scex_sumo.views.replay import FutureView, write_view
from scex_sumo.world.base import BatchStart, WorldRequest
from scex_sumo.world.sumo import SumoWorld
from tests.seeds import seed_of, standing

BLUE = (54, 124, 196)

LIVE = """
import sys
from pathlib import Path
from types import SimpleNamespace
import numpy as np
from scex_sumo.scene import States
from scex_sumo.world.base import BatchStart, SumoDriven, WorldRequest
from scex_sumo.world.sumo import SumoWorld

sys.path.insert(0, sys.argv[1])
from test_gui import scene, states

net = SimpleNamespace(path=Path(sys.argv[2]), extras=None)
with SumoWorld(WorldRequest(net=net, scene=scene(), slots=[0, 1], gui=True,
           models=["standard_driver"])) as world:
    drivers = [SumoDriven(future=1, vehicle=0, model="IDM", parameters={}, edges=("w_in", "e_out"))]
    for driven in ([], drivers):
        mask = np.ones((2, 2), dtype=bool)
        for d in driven:
            mask[d.future, d.vehicle] = False
        world.begin(BatchStart(slots=np.array([0, 1]), driven=driven), states(0))
        world.color(0, 1, (54, 124, 196))
        for step in range(1, 11):
            world.move(states(step), mask)
            world.step()
            read, plan = world.read()[mask], states(step)[mask]
            for key in ("x", "y", "heading", "speed"):
                assert np.abs(getattr(read, key) - getattr(plan, key)).max() < 1e-6
        x = world.read().x[1, 0]
        assert bool(driven) != (abs(x - 970.0) < 1e-6), x
print("shown")
"""


def states(step: int) -> States:
    """(2, 2): two cars on the main road, in two futures."""
    x = np.array([[960.0, 980.0], [960.0, 980.0]]) + step
    return States(x=x, y=np.full_like(x, 998.4), heading=np.zeros_like(x), speed=np.full_like(x, 10.0))


def scene() -> SeedScene:
    """The two cars, without a past worth mentioning."""
    return seed_of(standing(states(0)[0]))


@pytest.fixture
def display() -> list[str]:
    """What to put before a command that opens a window."""
    if os.environ.get("DISPLAY"):
        return []
    if shutil.which("xvfb-run") is None:
        pytest.skip("no display, and no Xvfb (apt-get install xvfb)")
    return ["xvfb-run", "-a", "-s", "-screen 0 1200x900x24"]


def run(command: list[str], folder: Path) -> str:
    environment = {**os.environ, "SUMO_HOME": sumo.SUMO_HOME}
    done = subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, timeout=100, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_a_world_in_sumo_gui_holds_what_was_planned(
    crossing: SimpleNamespace, display: list[str], tmp_path: Path
) -> None:
    tests = str(Path(__file__).parent)
    out = run([*display, sys.executable, "-c", LIVE, tests, str(crossing.path)], tmp_path)
    assert out == "shown\n"


def test_a_future_in_sumo_gui_shows_vehicles_in_the_colour_of_their_model(
    crossing: SimpleNamespace, display: list[str], tmp_path: Path
) -> None:
    track = States.stack([states(step)[0] for step in range(20)], axis=1)

    def blue_pixels(blue: str, other: str) -> int:
        future = FutureView(number=1, states=track, models=(blue, other), past=20)
        colors = {"standard_driver": BLUE, "risky_driver": (214, 64, 58)}
        write_view(tmp_path, crossing, scene(), [future], colors)
        settings = tmp_path / "future_0001.view.xml"
        # A picture after 1 s in place of the pause, at which sumo-gui would stay open.
        shown, count = re.subn(
            "<breakpoint.*/>", '<snapshot file="view.png" time="1"/>', settings.read_text()
        )
        assert count == 1
        settings.write_text(shown)
        program = str(Path(sumo.SUMO_HOME) / "bin" / "sumo-gui")
        run([*display, program, "-c", "future_0001.sumocfg", "--quit-on-end"], tmp_path)
        picture = 255 * imread(tmp_path / "view.png")[..., :3]
        assert picture.shape[0] > 300 and picture.shape[1] > 300
        return int((np.abs(picture - np.array(BLUE)).max(axis=2) < 3).sum())

    # Legend and one car, legend and two cars.
    one, two = (
        blue_pixels("standard_driver", "risky_driver"),
        blue_pixels("standard_driver", "standard_driver"),
    )
    assert one > 20 and two > one + 5


def test_without_a_display_the_error_says_so(
    crossing: SimpleNamespace, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with (
        SumoWorld(WorldRequest(net=crossing, scene=scene(), slots=[0], gui=True)) as world,
        pytest.raises(SimulationError, match="needs a display"),
    ):
        world.begin(BatchStart(slots=np.array([0])), states(0)[:1])
