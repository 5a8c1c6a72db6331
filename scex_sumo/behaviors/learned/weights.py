"""Files of weights: a network's numbers, how it was built, what it was trained on, and how well it does.

They are safetensors: plain numbers, and one text in JSON that says what they are; no code.
"""

from __future__ import annotations

import hashlib
import json
import zipfile
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
import safetensors
import safetensors.numpy

from scex_sumo.behaviors.learned.networks.architecture import Architecture, shapes
from scex_sumo.behaviors.learned.networks.layers import State
from scex_sumo.behaviors.learned.seen.inputs import PATH_COLUMNS
from scex_sumo.behaviors.scene_graph.graph import EDGE_COLUMNS, NODE_COLUMNS
from scex_sumo.errors import InputError
from scex_sumo.files import write_atomic
from scex_sumo.version import __version__

LARGEST_NUMBER = 1024
"""No number of an architecture is larger: a header that lies shall not cost memory."""
_SWITCHES = ("edges", "free")
FORMAT = "scex-sumo weights 2"
ABOUT = "scex_sumo"
"""Name of the text in the header."""
MODELS = {"graph": "graph_predictor", "hybrid": "graph_image_predictor"}
COLUMNS = {"node": NODE_COLUMNS, "edge": EDGE_COLUMNS, "path": PATH_COLUMNS}


@dataclass(frozen=True, kw_only=True, eq=False)
class Weights:
    """A network as its file has it.

    Attributes:
        sizes: from which it is built.
        state: its arrays by name, float32.
        meta: what `save_weights` was given, and ``version``, ``sha256``.
    """

    sizes: Architecture
    state: State
    meta: dict[str, Any]


def save_weights(
    path: str | Path, kind: str, sizes: Architecture, state: State, meta: Mapping[str, Any]
) -> None:
    """Write a network's weights as float32, with all that is needed to build and judge it.

    Args:
        path: the file.
        kind: ``graph`` or ``hybrid``.
        sizes: from which the network is built.
        state: its arrays by name.
        meta: plain values: training command, data, figures. One steers the driver: with mode=best, ``best``
            says whether it takes the ``expected`` mode (the default) or that with the largest logit
            (``likeliest``).
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
    """Read a network's weights.

    Args:
        path: the file.
        kind: ``graph`` or ``hybrid``.

    Raises:
        InputError: no such file, not a file of weights, weights of the other network or for other inputs.
    """
    file = Path(path)
    if not file.is_file():
        found = "is a folder" if file.is_dir() else "no such file"
        raise InputError(f"{file}: {found}; give a file that 'scex-sumo train' wrote")
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
            f"{file}: no file of weights ({type(error).__name__}); give one that 'scex-sumo train' wrote"
        ) from None
    except (TypeError, ValueError) as error:
        words = " ".join(str(error).split())[:160]
        raise InputError(f"{file}: weights of another architecture ({words}); {again}") from None
    if not all(np.isfinite(values).all() for values in state.values()):
        raise InputError(f"{file}: has weights that are not finite; {again}")
    meta = {**about["meta"], "version": about["version"], "sha256": sha256_of(file)}
    return Weights(sizes=sizes, state=state, meta=meta)


def _about(header: Mapping[str, str] | None) -> dict[str, Any] | None:
    """What a file says of itself; None where it is not one of ours."""
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
    """Raise an `InputError` for weights of the other network, or for other inputs."""
    if about["kind"] != kind:
        whose = MODELS.get(about["kind"], about["kind"][:40])
        raise InputError(f"{file}: weights of {whose}, needs those of {MODELS[kind]}; {again}")
    for name, columns in COLUMNS.items():
        found = about["columns"].get(name, ())
        if found != [*columns]:
            count = len(found) if isinstance(found, list) else "no"
            raise InputError(
                f"{file}: weights for {count} {name} inputs of version {about['version'][:40]}, version "
                f"{__version__} makes {len(columns)} others; {again}"
            )


def _sizes(kind: str, numbers: Any, opened: Any) -> Architecture:
    """The architecture of a file whose arrays have its shapes; a `ValueError` before they cost memory."""
    unknown = set(numbers) - {field.name for field in fields(Architecture)}
    if unknown:
        raise ValueError(f"unknown number {min(unknown)}")
    for name, number in numbers.items():
        if name in _SWITCHES and type(number) is not bool:
            raise ValueError(f"{name} is {str(number)[:20]}, yes or no expected")
        if name not in _SWITCHES and (type(number) is not int or not 1 <= number <= LARGEST_NUMBER):
            raise ValueError(f"{name} is {str(number)[:20]}, 1 to {LARGEST_NUMBER} expected")
    sizes, there = Architecture(**numbers), set(opened.keys())
    if sizes.heads > sizes.hidden:
        raise ValueError(f"{sizes.heads} heads for {sizes.hidden} numbers")
    for name, shape in shapes(kind, sizes).items():
        if name not in there:
            raise ValueError(f"no {name}")
        found = opened.get_slice(name)
        if found.get_dtype() != "F32" or tuple(found.get_shape()) != shape:
            raise ValueError(f"{name} is {found.get_dtype()} {found.get_shape()}, F32 {[*shape]} expected")
    return sizes


def sha256_of(file: Path) -> str:
    """Of the file's bytes."""
    return hashlib.sha256(file.read_bytes()).hexdigest()
