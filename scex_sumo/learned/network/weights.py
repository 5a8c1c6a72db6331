"""Files of weights: safetensors with a JSON header of origin and quality."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any, Final, NamedTuple

from scex_sumo.base.errors import InputError
from scex_sumo.base.files import sha256_of
from scex_sumo.base.schema import TEXT, record
from scex_sumo.base.tensors import read_about, read_tensors, save_tensors
from scex_sumo.base.version import __version__
from scex_sumo.graphs.graph import EDGE_COLUMNS, NODE_COLUMNS
from scex_sumo.learned.inputs.path_inputs import PATH_COLUMNS
from scex_sumo.learned.network.architecture import Architecture, shapes
from scex_sumo.learned.network.layers import State

MAX_NUMBER = 1024  # of an architecture: a false header must not cost memory
FORMAT = "scex-sumo weights 2"
MODELS = {"graph": "graph_predictor", "hybrid": "graph_image_predictor", "joint": "joint_predictor"}
COLUMNS = {"node": NODE_COLUMNS, "edge": EDGE_COLUMNS, "path": PATH_COLUMNS}


class Weights(NamedTuple):
    """A network from its file."""

    sizes: Architecture
    state: State  # by name, float32
    meta: dict[str, Any]  # that of `save_weights`, with ``version`` and ``sha256``


def save_weights(path: Path, kind: str, sizes: Architecture, state: State, meta: Mapping[str, Any]) -> None:
    """Write a network's weights as float32, with its architecture and origin; ``meta`` has plain values."""
    about = {
        "format": FORMAT,
        "kind": kind,
        "version": __version__,
        "architecture": asdict(sizes),
        "columns": COLUMNS,
        "meta": dict(meta),
    }
    save_tensors(path, state, about)


def load_weights(file: Path, kind: str) -> Weights:
    """Read a network's weights; ``kind`` is ``graph``, ``hybrid`` or ``joint``.

    Raises:
        InputError: the file is missing, no file of weights, of the other network, or for other inputs.
    """
    again = f"train again with: scex-sumo train {kind}"
    about = read_about(file, _ABOUT, again)
    _check_inputs(file, kind, about, again)
    sizes = Architecture(**about["architecture"])
    if sizes.heads > sizes.hidden:
        raise InputError(f"{file}: {sizes.heads} heads for {sizes.hidden} numbers; {again}")
    state = read_tensors(file, lambda _: shapes(kind, sizes), again)
    if not all((values > 0).all() for name, values in state.items() if name.endswith(".spread")):
        raise InputError(f"{file}: has inputs whose spread is not positive; {again}")
    meta = {**about["meta"], "version": about["version"], "sha256": sha256_of(file)}
    return Weights(sizes, state, meta)


_NUMBER: Final = {"type": "integer", "minimum": 1, "maximum": MAX_NUMBER}
_SIZES: Final = {
    field.name: {"type": "boolean"} if isinstance(field.default, bool) else _NUMBER
    for field in fields(Architecture)
}
_ABOUT: Final = record(
    {
        "format": {"const": FORMAT},
        **{"kind": TEXT, "version": TEXT, "columns": {"type": "object"}, "meta": {"type": "object"}},
        "architecture": {"type": "object", "properties": _SIZES, "additionalProperties": False},
    }
)


def _check_inputs(file: Path, kind: str, about: Mapping[str, Any], again: str) -> None:
    if about["kind"] != kind:
        whose = MODELS.get(about["kind"], about["kind"][:40])
        raise InputError(f"{file}: weights of {whose}, needs those of {MODELS[kind]}; {again}")
    for name, columns in COLUMNS.items():
        given = about["columns"].get(name, ())
        if given != [*columns]:
            count = len(given) if isinstance(given, list) else "no"
            raise InputError(
                f"{file}: trained by version {about['version'][:40]} with {count} {name} inputs; version "
                f"{__version__} has {len(columns)} others; {again}"
            )
