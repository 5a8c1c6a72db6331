"""Packed arrays of a page: small integers and floats by byte planes, deflated, as base64 text.

The JavaScript that reads them is ``assets/data.js``.
"""

from __future__ import annotations

import base64
import json
import math
import zlib
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scex_sumo.arrays import FloatArray, IntArray

_LEVEL = 6
_LEFT = (int, str)  # most there is
_INTEGERS = (np.int8, np.int16, np.int32)


def pack(info: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> str:
    """What a page shows, as text.

    Args:
        info: names, words and single numbers; becomes JSON, infinities null.
        arrays: integers, in the smallest type that holds them, and floats, in single precision.
    """
    planes: list[bytes] = []
    heads: list[dict[str, Any]] = []
    for name, values in arrays.items():
        small = smallest(values)
        heads.append({"name": name, "type": small.dtype.str[1:], "shape": small.shape})
        # Bytes of equal significance side by side: the upper ones hardly vary and compress to nothing.
        planes.append(small.reshape(-1, 1).view(np.uint8).T.tobytes() if small.size else b"")
    known = {"info": info, "arrays": heads}
    try:
        text = _json(known)
    except ValueError:  # an infinity
        text = _json(_plain(known))
    head = text.encode()
    whole = b"".join([len(head).to_bytes(4, "little"), head, *planes])
    return base64.b64encode(zlib.compress(whole, _LEVEL)).decode()


def _json(value: Any) -> str:
    return json.dumps(value, default=_plain, allow_nan=False, separators=(",", ":"))


def _plain(value: Any) -> Any:
    """Words and numbers as JSON has them; it knows no infinity, which becomes null."""
    if value is None or isinstance(value, str | int):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, list | tuple):
        return [entry if type(entry) in _LEFT else _plain(entry) for entry in value]
    if isinstance(value, Mapping):
        return {name: e if type(e) in _LEFT else _plain(e) for name, e in value.items()}
    return str(value)


def unpack(text: str) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """What was packed: the information, and the arrays by name."""
    whole = zlib.decompress(base64.b64decode(text))
    start = 4 + int.from_bytes(whole[:4], "little")
    head = json.loads(whole[4:start])
    arrays: dict[str, NDArray[Any]] = {}
    for entry in head["arrays"]:
        kind = np.dtype("<" + entry["type"])
        count = int(np.prod(entry["shape"], dtype=np.int64))
        stop = start + count * kind.itemsize
        planes = np.frombuffer(whole[start:stop], np.uint8).reshape(kind.itemsize, count)
        arrays[entry["name"]] = np.ascontiguousarray(planes.T).view(kind).reshape(entry["shape"])
        start = stop
    return head["info"], arrays


def smallest(values: NDArray[Any]) -> NDArray[Any]:
    """The same values in the smallest little-endian type of the page that holds them."""
    if values.dtype.kind == "f":
        return np.ascontiguousarray(values, dtype="<f4")
    low, high = (int(values.min()), int(values.max())) if values.size else (0, 0)
    for kind in _INTEGERS:
        if np.iinfo(kind).min <= low and high <= np.iinfo(kind).max:
            break
    return np.ascontiguousarray(values, dtype=np.dtype(kind).newbyteorder("<"))


def quantized(values: FloatArray, unit: float) -> IntArray:
    """Values as multiples of a unit."""
    return np.rint(np.asarray(values) / unit).astype(np.int64)


def second_differences(values: IntArray) -> IntArray:
    """Differences of differences along axis 1, as if two zeros went before; small where motion is steady."""
    before = np.zeros((values.shape[0], 2, *values.shape[2:]), dtype=values.dtype)
    return np.diff(np.concatenate([before, values], axis=1), n=2, axis=1)


def second_sums(differences: IntArray) -> IntArray:
    """The values that `second_differences` were taken of."""
    wide = np.asarray(differences, dtype=np.int64)
    return np.asarray(wide.cumsum(axis=1).cumsum(axis=1))
