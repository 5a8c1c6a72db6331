"""A small ONNX file written by hand: constant speed straight on, x = v·t, y = 0."""

from __future__ import annotations

from pathlib import Path

import numpy as np

FLOAT, INT64 = 1, 7  # TensorProto.DataType


def _varint(value: int) -> bytes:
    out = b""
    while True:
        value, low = value >> 7, value & 0x7F
        out += bytes([low | (0x80 if value else 0)])
        if not value:
            return out


def _field(number: int, value: int | str | bytes) -> bytes:
    """One field of a protobuf message: a varint, or a string of bytes with its length."""
    if isinstance(value, int):
        return _varint(number << 3) + _varint(value)
    data = value.encode() if isinstance(value, str) else value
    return _varint(number << 3 | 2) + _varint(len(data)) + data


def _tensor(name: str, values: np.ndarray) -> bytes:
    kind = FLOAT if values.dtype == np.float32 else INT64
    dims = b"".join(_field(1, int(d)) for d in values.shape)
    return dims + _field(2, kind) + _field(8, name) + _field(9, values.tobytes())


def _node(kind: str, inputs: list[str], output: str, axis: int | None = None) -> bytes:
    parts = [_field(1, name) for name in inputs] + [_field(2, output), _field(4, kind)]
    if axis is not None:  # AttributeProto: name, type INT (2), i
        parts.append(_field(5, _field(1, "axis") + _field(20, 2) + _field(3, axis)))
    return b"".join(parts)


def _value(name: str, shape: tuple[int | str, ...]) -> bytes:
    dims = b"".join(_field(1, _field(1 if isinstance(d, int) else 2, d)) for d in shape)
    return _field(1, name) + _field(2, _field(1, _field(1, FLOAT) + _field(2, dims)))


def write_onnx(path: Path, *inputs: tuple[str, tuple[int | str, ...]]) -> Path:
    """Write the model; inputs after the history are declared, and not used.

    Args:
        path: file to write.
        inputs: name and shape, free dimensions by name.
    """
    ways = np.stack([0.1 * np.arange(1, 31), np.zeros(30)], axis=-1).reshape(1, 60).astype(np.float32)
    constants = {"last": np.array(10), "speed": np.array([4]), "ways": ways, "shape": np.array([-1, 30, 2])}
    nodes = [
        _node("Gather", ["history", "last"], "now", axis=1),
        _node("Gather", ["now", "speed"], "v", axis=1),
        _node("MatMul", ["v", "ways"], "flat"),
        _node("Reshape", ["flat", "shape"], "trajectories"),
    ]
    declared = (("history", ("n", 11, 5)), *inputs)
    graph = b"".join(
        [
            *(_field(1, node) for node in nodes),
            _field(2, "straight"),
            *(_field(5, _tensor(name, values)) for name, values in constants.items()),
            *(_field(11, _value(name, shape)) for name, shape in declared),
            _field(12, _value("trajectories", ("n", 30, 2))),
        ]
    )
    path.write_bytes(_field(1, 8) + _field(7, graph) + _field(8, _field(2, 13)))
    return path
