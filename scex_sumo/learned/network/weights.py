"""Files of weights: safetensors with a JSON header of origin and quality."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
import safetensors
import safetensors.numpy

from scex_sumo.base.errors import InputError
from scex_sumo.base.files import sha256_of, write_atomic
from scex_sumo.base.version import __version__
from scex_sumo.graphs.graph import EDGE_COLUMNS, NODE_COLUMNS
from scex_sumo.learned.inputs.path_inputs import PATH_COLUMNS
from scex_sumo.learned.network.architecture import Architecture, shapes
from scex_sumo.learned.network.layers import State

MAX_NUMBER = 1024  # of an architecture: a false header must not cost memory
_SWITCHES = ("edges", "free")
FORMAT = "scex-sumo weights 2"
ABOUT = "scex_sumo"  # name of the text in the header
MODELS = {"graph": "graph_predictor", "hybrid": "graph_image_predictor", "joint": "joint_predictor"}
COLUMNS = {"node": NODE_COLUMNS, "edge": EDGE_COLUMNS, "path": PATH_COLUMNS}


@dataclass(frozen=True, kw_only=True, eq=False)
class Weights:
    """A network from its file."""

    sizes: Architecture
    state: State  # by name, float32
    meta: dict[str, Any]  # that of `save_weights`, with ``version`` and ``sha256``


def save_weights(
    path: str | Path, kind: str, sizes: Architecture, state: State, meta: Mapping[str, Any]
) -> None:
    """Write a network's weights as float32, with its architecture and origin.

    Args:
        kind: ``graph``, ``hybrid`` or ``joint``.
        meta: plain values: training command, data, figures. ``best`` is the mode of a driver with mode=best:
            ``expected`` (the default) or ``likeliest``, that with the largest logit.
    """
    about = {
        "format": FORMAT,
        "kind": kind,
        "version": __version__,
        "architecture": asdict(sizes),
        "columns": COLUMNS,
        "meta": dict(meta),
    }
    arrays = {name: np.ascontiguousarray(values, dtype=np.float32) for name, values in state.items()}
    write_atomic(Path(path), safetensors.numpy.save(arrays, {ABOUT: json.dumps(about)}))


def load_weights(path: str | Path, kind: str) -> Weights:
    """Read a network's weights; ``kind`` is ``graph``, ``hybrid`` or ``joint``.

    Raises:
        InputError: the file is missing, no file of weights, of the other network, or for other inputs.
    """
    file = Path(path)
    if not file.is_file():
        problem = "is a folder" if file.is_dir() else "no such file"
        raise InputError(f"{file}: {problem}; give a file that 'scex-sumo train' wrote")
    again = f"train again with: scex-sumo train {kind}"
    try:
        with safetensors.safe_open(file, framework="numpy") as opened:
            about = _about(opened.metadata())
            if about is None:
                raise InputError(
                    f"{file}: tensors, but not weights of scex-sumo; give a file that 'scex-sumo train' wrote"
                )
            _check_inputs(file, kind, about, again)
            sizes = _sizes(kind, about["architecture"], opened)
            state = {name: opened.get_tensor(name) for name in shapes(kind, sizes)}
    except (safetensors.SafetensorError, OSError) as error:
        if zipfile.is_zipfile(file):
            raise InputError(f"{file}: a PyTorch file, as earlier versions wrote it; {again}") from None
        raise InputError(
            f"{file}: not a file of weights ({type(error).__name__}); give one that 'scex-sumo train' wrote"
        ) from None
    except (TypeError, ValueError) as error:
        words = " ".join(str(error).split())[:160]
        raise InputError(f"{file}: weights of another architecture ({words}); {again}") from None
    if not all(np.isfinite(values).all() for values in state.values()):
        raise InputError(f"{file}: has weights that are not finite; {again}")
    if not all((values > 0).all() for name, values in state.items() if name.endswith(".spread")):
        raise InputError(f"{file}: has inputs whose spread is not positive; {again}")
    meta = {**about["meta"], "version": about["version"], "sha256": sha256_of(file)}
    return Weights(sizes=sizes, state=state, meta=meta)


def _about(header: Mapping[str, str] | None) -> dict[str, Any] | None:
    try:
        about = json.loads((header or {}).get(ABOUT, "0"))
    except (ValueError, RecursionError):
        return None
    ours = (
        isinstance(about, dict)
        and about.get("format") == FORMAT
        and all(isinstance(about.get(name), str) for name in ("kind", "version"))
        and all(isinstance(about.get(name), dict) for name in ("columns", "meta"))
        and "architecture" in about
    )
    return about if ours else None


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


def _sizes(kind: str, numbers: Any, opened: Any) -> Architecture:
    if not isinstance(numbers, dict):
        raise ValueError(f"a {type(numbers).__name__} instead of numbers by name")
    unknown = set(numbers) - {field.name for field in fields(Architecture)}
    if unknown:
        raise ValueError(f"unknown number {min(unknown)}")
    for name, number in numbers.items():
        if name in _SWITCHES and type(number) is not bool:
            raise ValueError(f"{name} is {str(number)[:20]}, yes or no expected")
        if name not in _SWITCHES and (type(number) is not int or not 1 <= number <= MAX_NUMBER):
            raise ValueError(f"{name} is {str(number)[:20]}, 1 to {MAX_NUMBER} expected")
    sizes, there = Architecture(**numbers), set(opened.keys())
    if sizes.heads > sizes.hidden:
        raise ValueError(f"{sizes.heads} heads for {sizes.hidden} numbers")
    for name, shape in shapes(kind, sizes).items():
        if name not in there:
            raise ValueError(f"no {name}")
        array = opened.get_slice(name)
        if array.get_dtype() != "F32" or tuple(array.get_shape()) != shape:
            raise ValueError(f"{name} is {array.get_dtype()} {array.get_shape()}, F32 {[*shape]} expected")
    return sizes
