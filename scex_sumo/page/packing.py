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
from scex_sumo.scene import STEP_S

UNITS = (0.02, 0.02, 0.002, 0.02)
"""Of x and y in m, heading in rad, speed in m/s; as in ``assets/data.js``."""
_LEVEL = 7
_SHIFT = 128  # values from -128 to 127 have equal upper bytes then


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
        small = small + small.dtype.type(_SHIFT) if small.dtype.kind == "i" and small.itemsize > 1 else small
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
        return [_plain(entry) for entry in value]
    if isinstance(value, Mapping):
        return {name: _plain(entry) for name, entry in value.items()}
    return str(value)


def smallest(values: NDArray[Any]) -> NDArray[Any]:
    """Return values in the smallest little-endian type that holds them."""
    if values.dtype.kind == "f":
        return np.ascontiguousarray(values, dtype="<f4")
    size = max(abs(int(values.min())), abs(int(values.max()) + 1)) if values.size else 0
    kind = "<i1" if size <= 1 << 7 else "<i2" if size <= 1 << 15 else "<i4"
    return np.ascontiguousarray(values, dtype=kind)


def quantized(values: FloatArray, unit: float | FloatArray) -> IntArray:
    """Return values as multiples of a unit."""
    return np.rint(np.asarray(values) / unit).astype(np.int64)


def coded_motion(start: IntArray, poses: FloatArray) -> IntArray:
    """Return what a track differs from steady motion by, small integers in `UNITS`.

    Args:
        start: (U, 4) x, y, heading, speed at the seed moment, in `UNITS`.
        poses: (U, T, 4) of the steps after it, m, rad, m/s; headings without jumps.

    Returns:
        (4, U, T): places off those that the mean velocity of a step leads to; second differences of heading
        and speed.
    """
    changes = quantized(poses[..., 2:], np.array(UNITS[2:])) - start[:, None, 2:]
    before = np.zeros((len(poses), 2, 2), dtype=np.int64)
    codes = np.empty((len(poses), poses.shape[1], 4), dtype=np.int64)
    codes[..., 2:] = np.diff(np.concatenate([before, changes], axis=1), n=2, axis=1)
    place, ahead = start[:, :2] * UNITS[:2], _ahead(start, changes)
    for step in range(poses.shape[1]):
        place = place + ahead[:, step]
        codes[:, step, :2] = quantized(poses[:, step, :2] - place, UNITS[0])
        place = place + codes[:, step, :2] * UNITS[0]
    return codes.transpose(2, 0, 1)


def _ahead(start: IntArray, changes: IntArray) -> FloatArray:
    """Return (U, T, 2) the way of each step at the mean of the velocities at its ends, m."""
    heading, speed = np.moveaxis(start[:, None, 2:] + np.pad(changes, ((0, 0), (1, 0), (0, 0))), 2, 0)
    turned, speeds = heading * UNITS[2], speed * UNITS[3]
    velocity = np.stack([speeds * np.cos(turned), speeds * np.sin(turned)], axis=2)
    travelled_m: FloatArray = STEP_S / 2 * (velocity[:, :-1] + velocity[:, 1:])
    return travelled_m
