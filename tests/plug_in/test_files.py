"""TorchScript and ONNX files drive vehicles, or say what is wrong with them."""

from __future__ import annotations

import importlib.util
import pickle
from pathlib import Path

import numpy as np
import pytest

from scex_sumo.base.errors import InputError, MissingExtraError, ScexError
from scex_sumo.drivers.registry import build, parse_models
from scex_sumo.scene import Plan
from tests.behaviors import roads
from tests.plug_in.onnx_export import write_onnx

SCENE = roads.scene_of((10.0, 0.0, np.pi / 2, 4.0), (60.0, 0.0, np.pi, 8.0))

MODULE = """
import torch


class Straight(torch.nn.Module):
    def forward(self, history, neighbours):
        x = history[:, -1, 4:] * 0.1 * torch.arange(1, 31)
        y = 0 * x + 0 * neighbours.sum(dim=(1, 2, 3))[:, None]
        return torch.stack([x, y], dim=-1)


class Two(torch.nn.Module):
    def forward(self, history):
        return history, history


class Stops(torch.nn.Module):
    def forward(self, history):
        assert bool(history.sum() > 1e9), "too slow"
        return history


class Camera(torch.nn.Module):
    def forward(self, history, camera):
        return history
"""


def driven(text: str) -> Plan:
    return roads.plan(build(parse_models(text)[0]), roads.straight(), roads.present(SCENE, 2))


def test_an_onnx_file_drives(tmp_path: Path) -> None:
    pytest.importorskip("onnxruntime")
    made = driven(f"onnx:file={write_onnx(tmp_path / 'm.onnx')}")
    ways = np.array([4.0, 8.0, 4.0, 8.0])[:, None] * 0.1 * np.arange(1, 31)
    assert made.y[0] == pytest.approx(ways[0], abs=1e-5)  # float32
    assert made.x[3] == pytest.approx(60.0 - ways[3], abs=1e-5)


def test_an_onnx_file_says_how_much_it_sees_unless_told_otherwise(tmp_path: Path) -> None:
    pytest.importorskip("onnxruntime")
    declared = (("neighbours", ("n", 6, 11, 5)), ("lanes", ("n", 20, "p", 2)))
    file = write_onnx(tmp_path / "m.onnx", *declared)
    built = build(parse_models(f"onnx:file={file}:radius=30")[0])
    around = built.surroundings  # type: ignore[attr-defined]
    assert (around.neighbours, around.lanes, around.points, around.radius) == (6, 20, 10, 30.0)
    told = build(parse_models(f"onnx:file={file}:points=7")[0])
    assert told.surroundings.points == 7  # type: ignore[attr-defined]
    assert driven(f"onnx:file={file}").x.shape == (4, 30)


def test_onnx_files_that_cannot_be_used_say_why(tmp_path: Path) -> None:
    pytest.importorskip("onnxruntime")
    foreign = tmp_path / "text.onnx"
    foreign.write_text("no model")
    for file, words in (
        (foreign, "text.onnx: not an ONNX file"),
        (write_onnx(tmp_path / "a.onnx", ("camera", ("n", 3))), "asks for an input 'camera'; there are: "),
        (write_onnx(tmp_path / "b.onnx", ("size", (1, 2))), r"input size has shape \[1, 2\], for 1 vehicles"),
    ):
        with pytest.raises(InputError, match=words):
            build(parse_models(f"onnx:file={file}")[0])


@pytest.fixture(scope="module")
def scripted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with TorchScript files."""
    torch = pytest.importorskip("torch")
    folder = tmp_path_factory.mktemp("scripted")
    (folder / "modules.py").write_text(MODULE)
    spec = importlib.util.spec_from_file_location("scripted_modules", folder / "modules.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    for name in ("Straight", "Two", "Stops", "Camera"):
        torch.jit.script(getattr(module, name)()).save(str(folder / f"{name}.pt"))
    return folder


ignore = pytest.mark.filterwarnings("ignore:.*torch.jit.*:DeprecationWarning")


@ignore
def test_a_torchscript_file_drives(scripted: Path) -> None:
    made = driven(f"torchscript:file={scripted / 'Straight.pt'}:neighbours=5")
    assert made.y[0] == pytest.approx(0.4 * np.arange(1, 31), abs=1e-5)
    assert made.speed[3] == pytest.approx(8.0, abs=1e-4)


@ignore
def test_a_torchscript_model_goes_to_another_process_by_its_file(scripted: Path) -> None:
    built = build(parse_models(f"torchscript:file={scripted / 'Straight.pt'}")[0])
    history = roads.present(SCENE)
    there = roads.plan(pickle.loads(pickle.dumps(built)), roads.straight(), history)
    assert np.array_equal(there.x, roads.plan(built, roads.straight(), history).x)


@ignore
def test_torchscript_files_that_cannot_be_used_say_why(scripted: Path, tmp_path: Path) -> None:
    foreign = tmp_path / "text.pt"
    foreign.write_text("no model")
    for file, words in (
        (foreign, "text.pt: not a TorchScript file: "),
        (scripted / "Camera.pt", "asks for an input 'camera'; there are: history, size"),
    ):
        with pytest.raises(InputError, match=words):
            build(parse_models(f"torchscript:file={file}")[0])
    with pytest.raises(Exception, match=r"Two.pt returned tuple, needs a tensor"):
        driven(f"torchscript:file={scripted / 'Two.pt'}")
    with pytest.raises(ScexError, match=r"^the network raised \w+: AssertionError: too slow$"):
        driven(f"torchscript:file={scripted / 'Stops.pt'}")


@pytest.mark.parametrize(
    ("model", "package", "extra"), [("onnx", "onnxruntime", "onnx"), ("torchscript", "torch", "learned")]
)
def test_what_is_not_installed_is_named_with_the_command_that_installs_it(
    model: str, package: str, extra: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == package else found(name))
    with pytest.raises(MissingExtraError, match=rf"{model}: needs {package}; .*'\.\[{extra}\]' in the clone"):
        build(parse_models(f"{model}:file=m")[0])
