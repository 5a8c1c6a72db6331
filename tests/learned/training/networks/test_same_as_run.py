"""The networks that run are those that were trained: torch's modules and ours in NumPy, same weights."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch")
from torch import nn  # noqa: E402

from scex_sumo.behaviors.driving.paths import chosen_paths  # noqa: E402
from scex_sumo.graphs.graph import scene_graph  # noqa: E402
from scex_sumo.learned.driver import OUTPUT_GRID, image_of  # noqa: E402
from scex_sumo.learned.inputs.path_inputs import path_inputs  # noqa: E402
from scex_sumo.learned.inputs.surface import raster_of  # noqa: E402
from scex_sumo.learned.network.architecture import Architecture, shapes  # noqa: E402
from scex_sumo.learned.network.layers import exact, snapped  # noqa: E402
from scex_sumo.learned.network.networks import KINDS as RUN  # noqa: E402
from scex_sumo.learned.network.networks import GraphNet, JointNet, Modes, Tokens  # noqa: E402
from scex_sumo.learned.network.weights import load_weights  # noqa: E402
from scex_sumo.learned.training.networks.graph import PathBatch, SceneBatch  # noqa: E402
from scex_sumo.learned.training.networks.graph_image import NETWORKS, ImageBatch, MapTensors, Net, save_net  # noqa: E402
from scex_sumo.scene import SceneHistory  # noqa: E402
from tests.behaviors import roads  # noqa: E402
from tests.learned import nets  # noqa: E402

ROAD = roads.fork()
SCENE = roads.scene_of((8.0, 0.3, 0.02, 6.0), (20.0, -0.2, 0.0, 5.0), (35.0, 0.0, 0.0, 4.0))
ROUNDING = 1e-12  # of float64 in a dozen layers
ROUGH = 0.02  # m/s² and m: what float32 and inputs off their grid make of it
ALONE = "whole."  # begins the names of what only trains


def apart(futures: int) -> SceneHistory:
    rng, history = np.random.default_rng(1), roads.present(SCENE, futures)
    for values, spread in ((history.states.x, 0.5), (history.states.y, 0.2), (history.states.heading, 0.02)):
        values += rng.normal(0, spread, (futures, SCENE.vehicles, 1))
    return history


def both(
    kind: str, net: Net, state: Any, sizes: Architecture, kept: torch.dtype
) -> tuple[Modes | Tokens, Modes | Tokens]:
    """What torch and NumPy say of some futures, every third vehicle asked for."""
    history = apart(5)
    vehicles, graph = roads.every(history)[np.arange(0, 15, 3)], scene_graph(history, ROAD)
    path = path_inputs(history, ROAD, vehicles, *chosen_paths(history, ROAD, vehicles, "straight"))
    own, raster = history.now[vehicles.future, vehicles.vehicle], raster_of(ROAD)
    pose, places = np.stack([own.x, own.y, own.heading], 1), np.arange(len(vehicles))

    def tensor(values: np.ndarray) -> torch.Tensor:
        return torch.from_numpy(np.ascontiguousarray(values)).to(kept)

    scene = SceneBatch(
        tensor(graph.node), tensor(graph.history), torch.from_numpy(graph.edge_index), tensor(graph.edge)
    )
    given: tuple[Any, ...] = scene, PathBatch(torch.from_numpy(path.node), tensor(path.features))
    running = RUN[kind](state, sizes)
    if kind == "hybrid":
        image = MapTensors(tensor(raster.values), torch.from_numpy(raster.corner))
        places = torch.arange(len(vehicles))
        given += (
            ImageBatch((image,), torch.zeros_like(places), torch.from_numpy(pose)),
            tensor(np.full(len(vehicles), 0.3)),
        )
    with torch.inference_mode():
        trained = net.to(kept).eval()(*given)
    wanted = Tokens if kind == "joint" else Modes
    every = (getattr(trained, name) for name in wanted._fields)
    theirs = wanted(*(None if part is None else part.numpy() for part in every))
    if isinstance(running, GraphNet | JointNet):
        return theirs, running(graph, path)
    return theirs, running(
        graph, path, image_of(ROAD, running), pose, np.arange(len(vehicles)), 0.3, free=True
    )


def on_grids(net: Net) -> None:
    """Have a module of torch round the inputs of its products as runs do."""

    def snap(module: nn.Module, given: Any) -> Any:
        return tuple(torch.from_numpy(snapped(values.numpy())) for values in given)

    for module in net.modules():
        if isinstance(module, nn.Linear | nn.Conv2d):
            module.register_forward_pre_hook(snap)
    if net.kind == "hybrid":
        net.image.convolve.register_forward_hook(lambda module, given, made: snap(module, (made,))[0])


CASES = [
    ("graph", {}),
    ("graph", {"edges": False}),
    ("hybrid", {}),
    ("hybrid", {"free": False, "layers": 1}),
    ("joint", {}),
]


@pytest.mark.parametrize(("kind", "numbers"), CASES)
def test_the_network_that_runs_is_the_one_that_was_trained(kind: str, numbers: dict[str, Any]) -> None:
    sizes = nets.small(**numbers)
    weights = nets.drawn(kind, SCENE, ROAD, sizes)
    state, share = exact(weights)
    assert share < 1
    net = NETWORKS[kind](sizes)
    for kept, mine in ((torch.float64, state), (torch.float32, weights)):
        given = {name: torch.from_numpy(values) for name, values in mine.items()}
        missing, unexpected = net.to(kept).load_state_dict(given, strict=False)
        assert not unexpected
        assert set(missing) == {name for name in net.state_dict() if name.startswith(ALONE)}
        assert bool(missing) == (kind == "joint")
        if kept == torch.float64:
            on_grids(net)
        theirs, ours = both(kind, net, state, sizes, kept)
        for name, one, other in zip(theirs._fields, theirs, ours, strict=True):
            if one is None or other is None:
                assert name in ("offset", "free")
                assert one is other
                continue
            off = np.abs(one - other).max()
            assert off < (ROUNDING if kept == torch.float64 else ROUGH), name
            if kept == torch.float64:
                assert np.array_equal(np.round(one / OUTPUT_GRID), np.round(other / OUTPUT_GRID))
        net = NETWORKS[kind](sizes)


@pytest.mark.parametrize(("kind", "numbers"), CASES)
def test_shapes_are_those_of_the_modules(kind: str, numbers: dict[str, Any]) -> None:
    sizes = nets.small(**numbers)
    state = NETWORKS[kind](sizes).state_dict()
    kept = {name: tuple(values.shape) for name, values in state.items() if not name.startswith(ALONE)}
    assert shapes(kind, sizes) == kept


@pytest.mark.parametrize("kind", ["graph", "hybrid", "joint"])
def test_trained_weights_come_back_from_their_file(tmp_path: Any, kind: str) -> None:
    torch.manual_seed(0)
    net = NETWORKS[kind](nets.small())
    save_net(tmp_path / "w", net, {"n": 1})
    back = load_weights(tmp_path / "w", kind)
    assert back.sizes == net.sizes
    state = net.state_dict()
    assert back.state.keys() == {name for name in state if not name.startswith(ALONE)}
    assert all(np.array_equal(values, state[name].numpy()) for name, values in back.state.items())


def test_several_maps_in_one_batch_give_what_each_gives_alone() -> None:
    torch.manual_seed(0)
    encoder = NETWORKS["hybrid"](nets.small()).image.double()
    rasters = (raster_of(ROAD), raster_of(roads.straight()))
    maps = tuple(MapTensors(torch.from_numpy(r.values), torch.from_numpy(r.corner)) for r in rasters)
    pose = torch.tensor([[20.0, 0.0, 0.0], [100.0, 1.0, 0.1]], dtype=torch.float64)
    two, one = torch.arange(2), torch.zeros(1, dtype=torch.int64)
    with torch.inference_mode():
        together = encoder(ImageBatch(maps, two, pose))
        for k in range(2):
            alone = encoder(ImageBatch((maps[k],), one, pose[k : k + 1]))
            assert torch.allclose(alone[0], together[k], atol=ROUNDING)
