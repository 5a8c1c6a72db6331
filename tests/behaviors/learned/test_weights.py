"""Files of weights: what comes back, and what is said of files that are not usable."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest
import torch

from scex_sumo.behaviors.learned.networks.graph import Architecture, GraphPredictorNet
from scex_sumo.behaviors.learned.networks.graph_image import GraphImageNet
from scex_sumo.behaviors.learned.networks.layers import make_exact
from scex_sumo.behaviors.learned.profiles import SHIPPED
from scex_sumo.behaviors.learned.weights import load_weights, save_weights, sha256_of
from scex_sumo.behaviors.registry import build, parse_models
from scex_sumo.errors import InputError
from tests.behaviors import roads
from tests.behaviors.learned import nets

ROAD, SCENE = roads.straight(), roads.scene_of((50.0, 0.0, 0.0, 10.0), (70.0, 0.3, 0.0, 8.0))


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return nets.untrained(tmp_path, "graph_predictor", SCENE, ROAD)


def altered(file: Path, **changes: Any) -> Path:
    content = torch.load(file, weights_only=True)
    torch.save({**content, **changes}, file)
    return file


@pytest.mark.parametrize(("kind", "cls"), [("graph", GraphPredictorNet), ("hybrid", GraphImageNet)])
def test_a_network_comes_back_as_it_was_with_what_was_said_of_it(
    tmp_path: Path, kind: str, cls: type
) -> None:
    net = nets.network(kind, SCENE, ROAD, modes=3)
    save_weights(tmp_path / "w.pt", net, {"command": "train", "figures": {"ade": 0.5}})
    back, meta = load_weights(tmp_path / "w.pt", kind)
    assert type(back) is cls
    assert back.sizes == net.sizes
    state = net.state_dict()
    assert all(torch.equal(value, state[key]) for key, value in back.state_dict().items())
    assert meta["command"] == "train"
    assert meta["figures"] == {"ade": 0.5}
    assert meta["sha256"] == sha256_of(tmp_path / "w.pt")


def test_the_same_weights_are_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a", "b"):
        save_weights(tmp_path / name, nets.network("graph", SCENE, ROAD), {"n": 1})
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def refused(name: str, file: Path) -> str:
    with pytest.raises(InputError) as caught:
        build(parse_models(f"{name}:weights={file}")[0])
    words = str(caught.value)
    assert "\n" not in words
    assert words.startswith(f"{file}: ")
    return words


def test_a_missing_file_says_so(tmp_path: Path) -> None:
    wanted = "no such file; give a file that 'scex-sumo train' wrote"
    assert wanted in refused("graph_predictor", tmp_path / "absent.pt")
    assert "is a folder" in refused("graph_predictor", tmp_path)


def test_something_else_than_weights_says_so(tmp_path: Path, file: Path) -> None:
    (tmp_path / "text.pt").write_text("hello")
    assert "no file of weights" in refused("graph_predictor", tmp_path / "text.pt")
    (tmp_path / "half.pt").write_bytes(file.read_bytes()[:2000])
    assert "no file of weights" in refused("graph_predictor", tmp_path / "half.pt")
    torch.save({"model": torch.zeros(3)}, tmp_path / "other.pt")
    assert "not weights of scex-sumo" in refused("graph_predictor", tmp_path / "other.pt")
    torch.save(torch.zeros(3), tmp_path / "tensor.pt")
    assert "not weights of scex-sumo" in refused("graph_predictor", tmp_path / "tensor.pt")


def test_code_in_a_file_is_not_run(tmp_path: Path) -> None:
    class Evil:
        def __reduce__(self) -> tuple[Any, ...]:
            return (Path.touch, (tmp_path / "ran",))

    torch.save({"format": Evil()}, tmp_path / "evil.pt")
    assert "no file of weights" in refused("graph_predictor", tmp_path / "evil.pt")
    assert not (tmp_path / "ran").exists()


def test_weights_of_the_other_model_are_refused(tmp_path: Path, file: Path) -> None:
    words = refused("graph_image_predictor", file)
    assert "weights of graph_predictor, needs those of graph_image_predictor" in words
    assert "scex-sumo train hybrid" in words


def test_weights_of_another_architecture_are_refused(file: Path) -> None:
    content = torch.load(file, weights_only=True)
    for change in ({"hidden": 32}, {"layers": 3}, {"depth": 3}, {"hidden": "wide"}):
        altered(file, architecture={**content["architecture"], **change})
        assert "weights of another architecture" in refused("graph_predictor", file)
    altered(file, architecture=7)
    assert "weights of another architecture" in refused("graph_predictor", file)


def test_a_width_of_zero_is_refused_before_a_network_is_built(file: Path) -> None:
    content = torch.load(file, weights_only=True)
    altered(file, architecture={**content["architecture"], "hidden": 0})
    assert "hidden is 0, 1 to 1024 expected" in refused("graph_predictor", file)


def test_weights_for_other_inputs_are_refused(file: Path) -> None:
    content = torch.load(file, weights_only=True)
    altered(file, columns={**content["columns"], "path": ["speed"]})
    assert "weights for 1 path inputs of version" in refused("graph_predictor", file)


@pytest.mark.parametrize(("value", "words"), [(float("nan"), "not finite"), (1e9, "the most that is exact")])
def test_weights_that_are_not_finite_or_huge_are_refused(file: Path, value: float, words: str) -> None:
    state = torch.load(file, weights_only=True)["state"]
    state["head.knots.weight"][0, 0] = value
    altered(file, state=state)
    assert words in refused("graph_predictor", file)


def test_the_free_head_needs_weights_that_have_it(tmp_path: Path) -> None:
    file = nets.untrained(tmp_path, "graph_image_predictor", SCENE, ROAD, free=False)
    assert build(parse_models(f"graph_image_predictor:weights={file}")[0])
    with pytest.raises(InputError, match="trained without the head for free trajectories; use head=bounded"):
        build(parse_models(f"graph_image_predictor:head=free:weights={file}")[0])


def test_the_shipped_weights_are_small_exact_and_say_what_they_are_made_from() -> None:
    sizes = 0
    for name, kind in nets.KIND_OF.items():
        file = SHIPPED / f"{name}.pt"
        net, meta = load_weights(file, kind)
        assert make_exact(net) < 1
        assert meta["command"].startswith(f"scex-sumo train {kind}")
        sizes += file.stat().st_size
    assert sizes <= 3_000_000


def test_a_header_that_lies_costs_neither_memory_nor_a_warning(file: Path) -> None:
    content = torch.load(file, weights_only=True)
    name, weights = next(iter(content["state"].items()))
    lies = [
        ("architecture", "layers", 1024),
        ("architecture", "heads", 1024),
        ("architecture", "modes", True),
        ("state", name, torch.zeros(1).expand(2**33)),
        ("state", name, weights.to(torch.complex64)),
        ("state", name, 7),
    ]
    for part, key, value in lies:
        altered(file, **{part: {**content[part], key: value}})
        assert "weights of another architecture" in refused("graph_predictor", file)


def test_weights_that_the_file_cannot_hold_are_refused(file: Path) -> None:
    content = torch.load(file, weights_only=True)
    wide = asdict(Architecture(**{**content["architecture"], "hidden": 512}))
    with torch.device("meta"):
        shapes = GraphPredictorNet(Architecture(**wide)).state_dict()
    drawn = {name: torch.zeros(1).expand(weights.shape) for name, weights in shapes.items()}
    altered(file, architecture=wide, state=drawn)
    assert "more weights than the file can hold" in refused("graph_predictor", file)
