"""The controller for CARLA against a stand-in of what it uses of CARLA and ScenarioRunner."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

from scex_sumo.exporters.request import EXPORTERS, Request
from scex_sumo.results.run import Run

pytest.importorskip("scenariogeneration")
FILE = Path(__file__).resolve().parents[2] / "docs" / "examples" / "carla_replay.py"


class Control:
    def __init__(self, actor: Any) -> None:
        self._actor, self._reached_goal = actor, False


@pytest.fixture
def controller(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    names = ["srunner", "srunner.scenariomanager", "srunner.scenariomanager.actorcontrols"]
    for name in [*names, f"{names[-1]}.basic_control", "carla"]:
        monkeypatch.setitem(sys.modules, name, ModuleType(name))
    sys.modules[f"{names[-1]}.basic_control"].BasicControl = Control  # type: ignore[attr-defined]
    for name in ("Location", "Rotation"):
        setattr(sys.modules["carla"], name, SimpleNamespace)
    sys.modules["carla"].Transform = lambda place, turn: (place, turn)  # type: ignore[attr-defined]
    spec = importlib.util.spec_from_file_location("carla_replay", FILE)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


class Actor:
    """A stand-in of ``carla.Vehicle``: a clock that the test sets, and where it was put."""

    def __init__(self, name: str) -> None:
        self.attributes = {"role_name": name}
        self.clock, self.physics = 100.0, True
        self.put: Any = None

    def get_transform(self) -> Any:
        return SimpleNamespace(location=SimpleNamespace(z=0.3))

    def get_world(self) -> Any:
        stamp = SimpleNamespace(elapsed_seconds=self.clock)
        return SimpleNamespace(get_snapshot=lambda: SimpleNamespace(timestamp=stamp))

    def set_simulate_physics(self, on: bool) -> None:
        self.physics = on

    def set_transform(self, transform: Any) -> None:
        self.put = transform


def test_the_actor_is_where_the_future_has_it_mirrored_into_carla_s_frame(
    run: Run, controller: ModuleType, tmp_path: Path
) -> None:
    file = EXPORTERS.load("openscenario")(Request(run=run, futures=(1,), out=tmp_path))[1]
    states = run.states(1)
    actor = Actor(f"vehicle{run.scene.track_ids[2]}")
    control = controller.Replay(actor, {"file": str(file)})
    assert not actor.physics
    for step in range(states.shape[1]):
        actor.clock = 100.0 + 0.1 * step
        control.run_step()
        place, turn = actor.put
        assert (place.x, place.y) == pytest.approx((states.x[2, step], -states.y[2, step]), abs=1e-3)
        assert np.cos(np.radians(-turn.yaw) - states.heading[2, step]) == pytest.approx(1.0)
        assert place.z == 0.3
    assert control._reached_goal
