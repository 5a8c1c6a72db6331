"""Packed page data: byte planes of small integers and floats, deflated, as base64 for ``assets/data.js``."""

from __future__ import annotations

import base64
import json
import math
import zlib
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scex_sumo.base.arrays import FloatArray, IntArray

_LEVEL = 6
_EXACT = (int, str)  # the most frequent types, which JSON writes as they are


def pack(info: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> str:
    """Return the data of a page as text.

    ``info`` becomes JSON, infinities null. Integers get the smallest type, floats single precision.
    """
    planes: list[bytes] = []
    heads: list[dict[str, Any]] = []
    for name, values in arrays.items():
        small = smallest(values)
        heads.append({"name": name, "type": small.dtype.str[1:], "shape": small.shape})
        # Bytes of equal significance side by side compress well: the upper ones hardly vary.
        planes.append(small.reshape(-1, 1).view(np.uint8).T.tobytes() if small.size else b"")
    content = {"info": info, "arrays": heads}
    try:
        text = _json(content)
    except ValueError:  # an infinity
        text = _json(_plain(content))
    head = text.encode()
    whole = b"".join([len(head).to_bytes(4, "little"), head, *planes])
    return base64.b64encode(zlib.compress(whole, _LEVEL)).decode()


def _json(value: Any) -> str:
    return json.dumps(value, default=_plain, allow_nan=False, separators=(",", ":"))


def _plain(value: Any) -> Any:
    if value is None or isinstance(value, str | int):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, list | tuple):
        return [entry if type(entry) in _EXACT else _plain(entry) for entry in value]
    if isinstance(value, Mapping):
        return {name: e if type(e) in _EXACT else _plain(e) for name, e in value.items()}
    return str(value)


def smallest(values: NDArray[Any]) -> NDArray[Any]:
    """Return values in the smallest little-endian type that holds them."""
    if values.dtype.kind == "f":
        return np.ascontiguousarray(values, dtype="<f4")
    size = max(abs(int(values.min())), abs(int(values.max()) + 1)) if values.size else 0
    kind = "<i1" if size <= 1 << 7 else "<i2" if size <= 1 << 15 else "<i4"
    return np.ascontiguousarray(values, dtype=kind)


def quantized(values: FloatArray, unit: float) -> IntArray:
    """Return values as multiples of a unit."""
    return np.rint(np.asarray(values) / unit).astype(np.int64)


def second_differences(values: IntArray) -> IntArray:
    """Return second differences along axis 1, after two zeros; small where motion is steady."""
    before = np.zeros((values.shape[0], 2, *values.shape[2:]), dtype=values.dtype)
    return np.diff(np.concatenate([before, values], axis=1), n=2, axis=1)


def second_sums(differences: IntArray) -> IntArray:
    """Return the inverse of `second_differences`."""
    return np.asarray(np.asarray(differences, dtype=np.int64).cumsum(axis=1).cumsum(axis=1))
