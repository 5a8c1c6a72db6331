"""Architecture of the networks: parameters and shapes of the weights."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import TypeAlias

from scex_sumo.behaviors.base import PLAN_STEPS
from scex_sumo.graphs.graph import EDGE_COLUMNS, HISTORY_COLUMNS, NODE_COLUMNS
from scex_sumo.learned.inputs.path_inputs import LEADER_COLUMNS, OWN_COLUMNS, PATH_COLUMNS
from scex_sumo.learned.inputs.surface import CHANNELS
from scex_sumo.scene import HISTORY_STEPS, STEP_S

KNOT_S = 0.5
TOKEN_STEPS = 5  # of a motion that `JointNet` draws
KNOTS = round(PLAN_STEPS * STEP_S / KNOT_S) + 1
STRONGEST_BRAKING = 9.0  # m/s²
STRONGEST_ACCELERATION = 5.0
WIDEST_OFFSET_M = 8.0  # from the present offset
SPEED, OFFSET = OWN_COLUMNS.index("speed"), OWN_COLUMNS.index("offset")
PRESENT = tuple(OWN_COLUMNS.index(name) for name in ("acceleration", "trend"))  # over the last 0.3 s and 1 s
HISTORY_NUMBERS = (HISTORY_STEPS + 1) * len(HISTORY_COLUMNS)
SCALED_LIMIT = 10.0  # standard deviations of an input from its mean
SLOPE = 0.2  # of attention scores below zero

AHEAD_M = (-8.0, -2.0, 4.0, 10.0, 16.0, 22.0, 29.0, 36.0, 43.0, 50.0)
ASIDE_M = (-12.0, -8.0, -5.0, -2.0, 2.0, 5.0, 8.0, 12.0)
FEATURES = 10  # channels of the convolutions besides the raster's
STRIDE = 2  # of the second convolution, pixels
COS, SIN = CHANNELS.index("cos"), CHANNELS.index("sin")

Shapes: TypeAlias = Mapping[str, tuple[int, ...]]


@dataclass(frozen=True, kw_only=True)
class Convolution:
    """One convolution of a map; between two of them is a ReLU."""

    inner: int
    outer: int
    side: int
    stride: int = 1
    padding: int = 0
    dilation: int = 1


CONVOLUTIONS = (
    Convolution(inner=len(CHANNELS), outer=12, side=3, padding=1),
    Convolution(inner=12, outer=20, side=3, stride=STRIDE, padding=1),
    Convolution(inner=20, outer=20, side=3, padding=2, dilation=2),
    Convolution(inner=20, outer=FEATURES, side=1),
)


@dataclass(frozen=True, kw_only=True)
class Architecture:
    """Parameters from which a network is built; stored with its weights."""

    node_columns: int = len(NODE_COLUMNS)
    edge_columns: int = len(EDGE_COLUMNS)
    path_columns: int = len(PATH_COLUMNS)
    hidden: int = 64  # width of all embeddings
    layers: int = 2  # attention layers on the graph
    heads: int = 4  # attention heads
    modes: int = 6  # M
    accelerations: int = 31  # A, classes of acceleration (joint only)
    sideways: int = 7  # S, classes of sideways speed (joint only)
    edges: bool = True  # False removes the graph's edges
    free: bool = True  # with the head for free trajectories (hybrid only)

    @property
    def attention_layers(self) -> int:
        """Number of attention layers."""
        return self.layers if self.edges else 0


def shapes(kind: str, sizes: Architecture) -> Shapes:
    """Return the shapes of a network's arrays by name; ``kind`` is ``graph``, ``hybrid`` or ``joint``."""
    hidden, double, hybrid = sizes.hidden, 2 * sizes.hidden, kind == "hybrid"
    result = dict(_scene(sizes))
    result.update(_scale("path_scale", sizes.path_columns))
    result.update(_mlp("path", sizes.path_columns, double, hidden))
    if hybrid:
        points = len(AHEAD_M) * len(ASIDE_M)
        for index, layer in enumerate(CONVOLUTIONS):
            result[f"image.convolve.{2 * index}.weight"] = (layer.outer, layer.inner, layer.side, layer.side)
            result[f"image.convolve.{2 * index}.bias"] = (layer.outer,)
        result.update(_mlp("image.read", points * (FEATURES + len(CHANNELS)), double, hidden))
        result.update(_mlp("own", sizes.path_columns - len(LEADER_COLUMNS), double, hidden))
        for name in ("graph_branch", "image_branch"):
            result.update(_mlp(name, double, double, hidden))
    result.update(_mlp("head.body", double, double, double))
    if kind == "joint":
        result["head.acceleration"], result["head.sideways"] = (sizes.accelerations,), (sizes.sideways,)
        result.update(_linear("head.choice", double, sizes.accelerations * sizes.sideways + 1))
        return result
    free = 2 * KNOTS if hybrid and sizes.free else 0
    result.update(_linear("head.knots", double, sizes.modes * (2 * KNOTS - 1 + free)))
    result.update(_linear("head.choice", double, sizes.modes + 1 + len(PRESENT)))
    return result


def _scene(sizes: Architecture) -> Iterator[tuple[str, tuple[int, ...]]]:
    hidden, per_head = sizes.hidden, sizes.hidden // sizes.heads
    yield from _scale("scene.node_scale", sizes.node_columns)
    yield from _scale("scene.edge_scale", sizes.edge_columns)
    yield from _scale("scene.history_scale", HISTORY_NUMBERS)
    yield from _mlp("scene.embed", sizes.node_columns + HISTORY_NUMBERS, 2 * hidden, hidden)
    for layer in range(sizes.attention_layers):
        name = f"scene.attend.{layer}"
        yield from _linear(f"{name}.lin_l", hidden, sizes.heads * per_head)
        yield from _linear(f"{name}.lin_r", hidden, sizes.heads * per_head)
        yield f"{name}.lin_edge.weight", (sizes.heads * per_head, sizes.edge_columns)
        yield f"{name}.att", (1, sizes.heads, per_head)
        yield f"{name}.bias", (sizes.heads * per_head,)
    for layer in range(sizes.attention_layers + 1):
        yield f"scene.norm.{layer}.weight", (hidden,)
        yield f"scene.norm.{layer}.bias", (hidden,)


def _scale(name: str, columns: int) -> Iterator[tuple[str, tuple[int, ...]]]:
    yield f"{name}.mean", (columns,)
    yield f"{name}.spread", (columns,)


def _linear(name: str, inner: int, outer: int) -> Iterator[tuple[str, tuple[int, ...]]]:
    yield f"{name}.weight", (outer, inner)
    yield f"{name}.bias", (outer,)


def _mlp(name: str, *sizes: int) -> Iterator[tuple[str, tuple[int, ...]]]:
    for index, (inner, outer) in enumerate(pairwise(sizes)):
        yield from _linear(f"{name}.{2 * index}", inner, outer)
