"""Cache on the disk, between runs."""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
import os
from collections.abc import Callable, Mapping
from dataclasses import fields
from functools import cache
from pathlib import Path
from typing import Any, Literal, TypeVar

import numpy as np

from scex_sumo.base.errors import ResultError
from scex_sumo.base.files import cache_folder, write_atomic

Made = TypeVar("Made")

_DIGEST = 32  # bytes of a SHA-256
MAX_FILES = 64  # of a kind; the least recently used one is removed first


def cached_bytes(kind: str, made_of: bytes, make: Callable[[], bytes]) -> bytes:
    """Return the cached result of ``make``, or call it and cache the result on the disk.

    Args:
        made_of: everything that the result depends on, except our own code and NumPy.
    """
    file = cache_folder() / kind / hashlib.sha256(code_key() + made_of).hexdigest()
    with contextlib.suppress(OSError):  # not there
        content = file.read_bytes()
        if content[:_DIGEST] == hashlib.sha256(content[_DIGEST:]).digest():  # whole
            os.utime(file)
            return content[_DIGEST:]
    content_made = make()
    with contextlib.suppress(OSError, ResultError):  # a full disk stops no run
        file.parent.mkdir(parents=True, exist_ok=True)
        write_atomic(file, hashlib.sha256(content_made).digest() + content_made)
        for old in sorted(file.parent.iterdir(), key=lambda old: old.stat().st_mtime)[:-MAX_FILES]:
            old.unlink(missing_ok=True)
    return content_made


def cached_object(kind: str, made_of: bytes, make: Callable[[], Made], parts: tuple[type, ...]) -> Made:
    """Return the cached result of ``make``: dataclasses ``parts`` of arrays, texts and numbers."""
    packed = cached_bytes(kind, made_of, lambda: pack(make(), parts))
    try:
        unpacked: Made = unpack(packed, parts)
    except UNPACKABLE:
        return make()
    return unpacked


UNPACKABLE = (ValueError, LookupError, TypeError, AttributeError, OverflowError, RecursionError)
"""Errors of `unpack` by other bytes than those of `pack`."""


def pack(value: Any, parts: tuple[type, ...]) -> bytes:
    """Return dataclasses ``parts`` of arrays, texts and numbers as bytes that run no code when read."""
    content: list[bytes] = []
    classes = _by_name(parts)

    def plain(value: Any) -> Any:
        if value is None or type(value) in (bool, int, float, str):
            return value
        if isinstance(value, np.ndarray | np.generic):
            order: Literal["C", "F"] = "C" if value.flags.c_contiguous else "F"
            content.append(value.tobytes(order))
            return {"array": [value.dtype.str, value.shape, order, isinstance(value, np.generic)]}
        if isinstance(value, Mapping):
            return {"dict": [[plain(key), plain(entry)] for key, entry in value.items()]}
        if isinstance(value, tuple | list):
            return {type(value).__name__: [plain(entry) for entry in value]}
        if isinstance(value, Path):
            return {"path": str(value)}
        name = type(value).__name__
        if classes.get(name) is not type(value):
            raise TypeError(f"{name} is no part of what is cached")
        names = [field.name for field in fields(classes[name])]
        return {"class": name, "fields": {field: plain(getattr(value, field)) for field in names}}

    head = json.dumps(plain(value)).encode()
    return b"".join([head, b"\n", *content])


def unpack(packed: bytes, parts: tuple[type, ...]) -> Any:
    """Return the value of `pack`."""
    head, _, content = packed.partition(b"\n")
    offset, classes = 0, _by_name(parts)

    def array(kind: str, shape: list[int], order: Literal["C", "F"], scalar: bool) -> Any:
        nonlocal offset
        dtype = np.dtype(kind)
        if dtype.kind not in "biufU":
            raise ValueError(f"arrays of {kind} are not expected")
        count = math.prod(shape)
        values = np.frombuffer(content, dtype, count, offset) if count else np.empty(0, dtype)
        offset += values.nbytes
        return values[0] if scalar else values.reshape(shape, order=order).copy(order="K")

    def whole(value: Any) -> Any:
        if not isinstance(value, dict):
            return value
        if "class" in value:
            return classes[value["class"]](**{name: whole(entry) for name, entry in value["fields"].items()})
        ((kind, content),) = value.items()
        if kind == "array":
            return array(*content)
        if kind == "dict":
            return {whole(key): whole(entry) for key, entry in content}
        if kind == "path":
            return Path(content)
        return {"tuple": tuple, "list": list}[kind](map(whole, content))

    return whole(json.loads(head))


def _by_name(parts: tuple[type, ...]) -> dict[str, type]:
    return {kind.__name__: kind for kind in parts}


@cache
def code_key() -> bytes:
    """Return the SHA-256 of our own modules and NumPy's version, for cache keys; read once in a process."""
    digest = hashlib.sha256(np.__version__.encode())
    for folder, _, names in sorted(os.walk(Path(__file__).parents[1])):
        for name in sorted(name for name in names if name.endswith(".py")):
            source = Path(folder, name).read_bytes()
            digest.update(f"\n{name} {len(source)}\n".encode() + source)
    return digest.digest()
