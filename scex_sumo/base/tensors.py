"""Files of tensors: safetensors with a JSON text about them in the header, checked when they are read."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final, TypeAlias

import numpy as np
import safetensors
import safetensors.numpy
from numpy.typing import NDArray

from scex_sumo.base.errors import InputError, one_line
from scex_sumo.base.files import write_atomic
from scex_sumo.base.schema import Schema, parse_json

Shape: TypeAlias = tuple[int, ...]
ABOUT: Final = "scex_sumo"
"""Name of the text in the header."""
MOST: Final = 1e6
"""Largest magnitude of a value: others come from no training."""


def save_tensors(path: Path, arrays: Mapping[str, Any], about: Mapping[str, Any]) -> None:
    """Write arrays as float32, and plain values about them."""
    tensors = {name: np.ascontiguousarray(values, np.float32) for name, values in arrays.items()}
    write_atomic(path, safetensors.numpy.save(tensors, {ABOUT: json.dumps(about)}))


def read_about(path: Path, schema: Schema, again: str) -> dict[str, Any]:
    """Return what a file says about its tensors; else raise an `InputError` with the remedy ``again``."""
    with _opened(path, again) as opened:
        if ABOUT not in (said := opened.metadata() or {}):
            raise ValueError("tensors of another program")
        about: dict[str, Any] = parse_json(said[ABOUT], schema)
        return about


def read_tensors(
    path: Path, expected: Callable[[Mapping[str, Shape]], Mapping[str, Shape]], again: str
) -> dict[str, NDArray[np.float32]]:
    """Return the tensors of a file, finite and of their shapes; errors as of `read_about`.

    Args:
        expected: returns the shapes by name of the tensors that are needed, from those in the file.
    """
    with _opened(path, again) as opened:
        parts = {name: opened.get_slice(name) for name in opened.keys()}  # noqa: SIM118
        shapes = {name: tuple(tensor.get_shape()) for name, tensor in parts.items()}
        for name, shape in expected(shapes).items():
            if name not in parts:
                raise ValueError(f"no {name}")
            if parts[name].get_dtype() != "F32" or shapes[name] != shape:
                raise ValueError(f"{name} is {parts[name].get_dtype()} {shapes[name]}, needs F32 {shape}")
        tensors = {name: opened.get_tensor(name) for name in expected(shapes)}
        for name, values in tensors.items():
            if not (np.abs(values) <= MOST).all():
                raise ValueError(f"{name} has values that are not finite, or beyond {MOST:g}")
        return tensors


@contextmanager
def _opened(path: Path, again: str) -> Iterator[Any]:
    if not path.is_file():
        raise InputError(f"{path}: {'is a folder' if path.is_dir() else 'no such file'}; {again}")
    try:
        with safetensors.safe_open(path, framework="numpy") as opened:
            yield opened
    except (safetensors.SafetensorError, OSError) as error:
        kind = "a PyTorch file, as earlier versions wrote it" if zipfile.is_zipfile(path) else "no tensors"
        raise InputError(f"{path}: {kind} ({type(error).__name__}); {again}") from None
    except (KeyError, IndexError, TypeError, ValueError) as error:
        raise InputError(f"{path}: {one_line(error)[:160]}; {again}") from None
