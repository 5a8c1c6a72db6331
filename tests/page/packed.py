"""Packed data of a page read as its JavaScript reads it. For tests alone."""

from __future__ import annotations

import base64
import json
import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scex_sumo.page.packing import UNITS, _ahead


def unpack(text: str) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Return the information, and the arrays by name."""
    whole = zlib.decompress(base64.b64decode(text))
    start = 4 + int.from_bytes(whole[:4], "little")
    head = json.loads(whole[4:start])
    arrays: dict[str, NDArray[Any]] = {}
    for entry in head["arrays"]:
        kind = np.dtype("<" + entry["type"])
        count = int(np.prod(entry["shape"], dtype=np.int64))
        stop = start + count * kind.itemsize
        planes = np.frombuffer(whole[start:stop], np.uint8).reshape(kind.itemsize, count)
        values = np.ascontiguousarray(planes.T).view(kind).reshape(entry["shape"])
        arrays[entry["name"]] = values - kind.type(128) if entry["type"] in ("i2", "i4") else values
        start = stop
    return head["info"], arrays


def decoded_motion(start: NDArray[Any], motion: NDArray[Any]) -> NDArray[np.float64]:
    """Return (U, T, 4) poses of `coded_motion`, as ``data.js`` does."""
    codes = np.asarray(motion, dtype=np.int64).transpose(1, 2, 0)
    changes = codes[..., 2:].cumsum(axis=1).cumsum(axis=1)
    moved = (_ahead(start, changes) + codes[..., :2] * UNITS[0]).cumsum(axis=1)
    places = start[:, None, :2] * UNITS[:2] + moved
    return np.concatenate([places, (start[:, None, 2:] + changes) * UNITS[2:]], axis=2)
