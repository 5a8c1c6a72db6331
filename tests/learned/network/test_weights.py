"""Files of weights: what comes back, and what is said of files that are not usable."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import safetensors.numpy

from scex_sumo.base.errors import InputError
from scex_sumo.base.files import sha256_of
from scex_sumo.base.tensors import ABOUT
from scex_sumo.drivers.registry import build, parse_models
from scex_sumo.learned.driver import SHIPPED
from scex_sumo.learned.network.layers import exact
from scex_sumo.learned.network.weights import load_weights, save_weights
from tests.behaviors import roads
from tests.learned import nets

ROAD, SCENE = roads.straight(), roads.scene_of((50.0, 0.0, 0.0, 10.0), (70.0, 0.3, 0.0, 8.0))


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return nets.untrained(tmp_path, "graph_predictor", SCENE, ROAD)


def about(file: Path) -> dict[str, Any]:
    with safetensors.safe_open(file, framework="numpy") as opened:
        return json.loads(opened.metadata()[ABOUT])


def altered(file: Path, *, state: dict[str, np.ndarray] | None = None, **changes: Any) -> Path:
    state = safetensors.numpy.load_file(file) if state is None else state
    header = {ABOUT: json.dumps({**about(file), **changes})}
    file.write_bytes(safetensors.numpy.save(state, header))
    return file


@pytest.mark.parametrize("kind", ["graph", "hybrid"])
def test_weights_come_back_as_they_were_with_what_was_said_of_them(tmp_path: Path, kind: str) -> None:
    sizes = nets.small(modes=3)
    state = nets.drawn(kind, SCENE, ROAD, sizes)
    save_weights(tmp_path / "w", kind, sizes, state, {"command": "train", "figures": {"ade": 0.5}})
    back = load_weights(tmp_path / "w", kind)
    assert back.sizes == sizes
    assert {name: values.tolist() for name, values in back.state.items()} == {
        name: values.tolist() for name, values in state.items()
    }
    assert back.meta["command"] == "train"
    assert back.meta["figures"] == {"ade": 0.5}
    assert back.meta["sha256"] == sha256_of(tmp_path / "w")


def refused(name: str, file: Path) -> str:
    with pytest.raises(InputError) as caught:
        build(parse_models(f"{name}:weights={file}")[0])
    words = str(caught.value)
    assert "\n" not in words
    assert words.startswith(f"{file}: ")
    return words


def test_weights_of_another_architecture_are_refused(file: Path) -> None:
    numbers = about(file)["architecture"]
    for change, words in (
        ({"hidden": 32}, "needs F32"),
        ({"layers": 3}, "no "),
        ({"depth": 3}, "architecture.depth is unknown"),
        ({"hidden": "wide"}, 'architecture.hidden is "wide", needs integer'),
    ):
        altered(file, architecture={**numbers, **change})
        assert words in refused("graph_predictor", file)
    for wrong in (7, None, [1], "hidden", [["hidden"]], "", []):
        altered(file, architecture=wrong)
        assert "architecture is " in refused("graph_predictor", file)


def test_weights_for_other_inputs_are_refused(file: Path) -> None:
    columns = about(file)["columns"]
    altered(file, columns={**columns, "path": ["speed"]})
    assert "with 1 path inputs; version" in refused("graph_predictor", file)
    altered(file, columns={**columns, "path": 7})
    assert "with no path inputs; version" in refused("graph_predictor", file)


@pytest.mark.parametrize(("value", "words"), [(float("nan"), "not finite"), (1e9, "beyond 1e+06")])
def test_weights_that_are_not_finite_or_huge_are_refused(file: Path, value: float, words: str) -> None:
    state = safetensors.numpy.load_file(file)
    state["head.knots.weight"][0, 0] = value
    altered(file, state=state)
    assert words in refused("graph_predictor", file)


def test_the_shipped_weights_are_small_exact_and_say_what_they_are_made_from() -> None:
    sizes = 0
    for name, kind in nets.KIND_OF.items():
        file = SHIPPED / f"{name}.safetensors"
        weights = load_weights(file, kind)
        assert exact(weights.state)[1] < 1
        assert weights.meta["command"].startswith(f"scex-sumo train {kind}")
        sizes += file.stat().st_size
    assert sizes <= 3_000_000


def test_a_header_that_lies_is_refused(file: Path) -> None:
    numbers, state = about(file)["architecture"], safetensors.numpy.load_file(file)
    for key, value, words in (
        ("layers", 1024, "no "),
        ("heads", 1024, "1024 heads for"),
        ("modes", True, "architecture.modes is true, needs integer"),
        ("edges", 1, "architecture.edges is 1, needs boolean"),
    ):
        altered(file, state=state, architecture={**numbers, key: value})
        assert words in refused("graph_predictor", file)
    altered(file, architecture=numbers)
    name = next(iter(state))
    for wrong in (state[name].astype(np.float64), state[name][None], np.zeros(0, np.float32)):
        altered(file, state={**state, name: wrong})
        assert f"{name} is F" in refused("graph_predictor", file)
    altered(file, state={key: values for key, values in state.items() if key != name})
    assert f"no {name}; train again" in refused("graph_predictor", file)
