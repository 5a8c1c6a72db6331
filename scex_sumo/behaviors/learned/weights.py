"""Files of weights: a network's numbers, how it was built, what it was trained on, and how well it does."""

from __future__ import annotations

import hashlib
import io
import warnings
from collections.abc import Mapping
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import torch

from scex_sumo.behaviors.learned.networks.graph import Architecture, GraphPredictorNet
from scex_sumo.behaviors.learned.networks.graph_image import GraphImageNet
from scex_sumo.behaviors.learned.seen.inputs import PATH_COLUMNS
from scex_sumo.behaviors.scene_graph.graph import EDGE_COLUMNS, NODE_COLUMNS
from scex_sumo.errors import InputError
from scex_sumo.files import write_atomic
from scex_sumo.version import __version__

LARGEST_NUMBER = 1024
"""No number of an architecture is larger: a header that lies shall not cost memory."""
_SWITCHES = ("edges", "free")
FORMAT = "scex-sumo weights 1"
KINDS: Mapping[str, type[GraphPredictorNet] | type[GraphImageNet]] = {
    "graph": GraphPredictorNet,
    "hybrid": GraphImageNet,
}
MODELS = {"graph": "graph_predictor", "hybrid": "graph_image_predictor"}
COLUMNS = {"node": NODE_COLUMNS, "edge": EDGE_COLUMNS, "path": PATH_COLUMNS}


def save_weights(path: str | Path, net: GraphPredictorNet | GraphImageNet, meta: Mapping[str, Any]) -> None:
    """Write a network's weights as float32, with all that is needed to build and judge it.

    Args:
        path: the file.
        net: the network.
        meta: plain values: training command, data, figures. One steers the driver: with mode=best, ``best``
            says whether it takes the ``expected`` mode (the default) or that with the largest logit
            (``likeliest``).
    """
    state = {
        key: value.detach().float().cpu() if value.is_floating_point() else value.cpu()
        for key, value in net.state_dict().items()
    }
    content = {
        "format": FORMAT,
        "kind": net.kind,
        "version": __version__,
        "architecture": asdict(net.sizes),
        "columns": {name: list(columns) for name, columns in COLUMNS.items()},
        "state": state,
        "meta": dict(meta),
    }
    buffer = io.BytesIO()
    torch.save(content, buffer)
    write_atomic(Path(path), buffer.getvalue())


def load_weights(path: str | Path, kind: str) -> tuple[GraphPredictorNet | GraphImageNet, dict[str, Any]]:
    """Build a network from its file, float32, ready to be trained further.

    Args:
        path: the file.
        kind: ``graph`` or ``hybrid``.

    Returns:
        The network and its meta data: what `save_weights` was given, and ``version``, ``sha256``.

    Raises:
        InputError: no such file, not a file of weights, weights of the other network or for other inputs.
    """
    file = Path(path)
    content = _read(file)
    if content["kind"] != kind:
        raise InputError(
            f"{file}: weights of {MODELS.get(content['kind'], content['kind'])}, needs those of "
            f"{MODELS[kind]}; train them with: scex-sumo train {kind}"
        )
    for name, columns in COLUMNS.items():
        found = content["columns"].get(name, ())
        if tuple(found) != columns:
            raise InputError(
                f"{file}: weights for {len(found)} {name} inputs of version {content['version']}, version "
                f"{__version__} makes {len(columns)} others; train again with: scex-sumo train {kind}"
            )
    net = _build(file, kind, content)
    return net, {**content["meta"], "version": content["version"], "sha256": sha256_of(file)}


def _build(file: Path, kind: str, content: dict[str, Any]) -> GraphPredictorNet | GraphImageNet:
    try:
        known = {field.name for field in fields(Architecture)}
        unknown = set(content["architecture"]) - known
        if unknown:
            raise ValueError(f"unknown number {min(unknown)}")
        for name, number in content["architecture"].items():
            if name in _SWITCHES and type(number) is not bool:
                raise ValueError(f"{name} is {str(number)[:20]}, yes or no expected")
            if name not in _SWITCHES and (type(number) is not int or not 1 <= number <= LARGEST_NUMBER):
                raise ValueError(f"{name} is {str(number)[:20]}, 1 to {LARGEST_NUMBER} expected")
        sizes = Architecture(**content["architecture"])
        if sizes.heads > sizes.hidden or sizes.layers > len(content["state"]):
            raise ValueError(f"{sizes.layers} layers of {sizes.heads} heads for {sizes.hidden} numbers")
        _check_state(file, KINDS[kind], sizes, content["state"])
        net = KINDS[kind](sizes)
        net.load_state_dict(content["state"])
    except (RuntimeError, TypeError, ValueError, KeyError, AttributeError, ArithmeticError) as error:
        words = " ".join(str(error).split())[:160]
        raise InputError(
            f"{file}: weights of another architecture ({words}); train again with: scex-sumo train {kind}"
        ) from None
    if not all(bool(torch.isfinite(value).all()) for value in net.state_dict().values()):
        raise InputError(f"{file}: has weights that are not finite; train again with: scex-sumo train {kind}")
    return net


def _check_state(
    file: Path, kind: type[GraphPredictorNet] | type[GraphImageNet], sizes: Architecture, state: Any
) -> None:
    """Raise an error for weights of other shapes than the network's, before that costs any memory."""
    with torch.device("meta"):
        wanted = kind(sizes).state_dict()
    for name, weights in state.items():
        plain = isinstance(weights, torch.Tensor) and weights.layout == torch.strided
        if not plain or weights.is_complex():
            raise ValueError(f"{name[:60]} holds no plain numbers")
        if name in wanted and weights.shape != wanted[name].shape:
            raise ValueError(f"{name} is {[*weights.shape]}, {[*wanted[name].shape]} expected")
    missing = [name for name in wanted if name not in state]
    if missing:
        raise ValueError(f"no {missing[0]}")
    if sum(weights.numel() for weights in wanted.values()) > file.stat().st_size:  # two bytes each, at least
        raise ValueError("more weights than the file can hold")


def _read(file: Path) -> dict[str, Any]:
    if not file.is_file():
        found = "is a folder" if file.is_dir() else "no such file"
        raise InputError(f"{file}: {found}; give a file that 'scex-sumo train' wrote")
    try:
        with warnings.catch_warnings():  # what torch doubts about a file, the error below says in one line
            warnings.simplefilter("ignore")
            content = torch.load(file, map_location="cpu", weights_only=True)
    except Exception as error:  # torch raises whatever its unpickler meets
        raise InputError(
            f"{file}: no file of weights ({type(error).__name__}); give one that 'scex-sumo train' wrote"
        ) from None
    needed = ("kind", "version", "architecture", "columns", "state", "meta")
    if (
        not isinstance(content, dict)
        or content.get("format") != FORMAT
        or any(k not in content for k in needed)
        or not all(isinstance(content[k], str) for k in ("kind", "version"))
        or not all(_is_named(content[k]) for k in ("columns", "state", "meta"))
        or not all(isinstance(names, list | tuple) for names in content["columns"].values())
    ):
        raise InputError(
            f"{file}: a PyTorch file, but not weights of scex-sumo; give a file that 'scex-sumo train' wrote"
        )
    return content


def _is_named(value: object) -> bool:
    """Whether a value is a mapping of texts."""
    return isinstance(value, Mapping) and all(isinstance(key, str) for key in value)


def sha256_of(file: Path) -> str:
    """Of the file's bytes."""
    return hashlib.sha256(file.read_bytes()).hexdigest()
