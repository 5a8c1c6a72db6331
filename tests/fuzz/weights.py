"""Files of weights that lie: headers changed, arrays of other shapes, pickles that would run code."""

from __future__ import annotations

import json
import os
import pickle
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import safetensors.numpy

from scex_sumo.base.tensors import ABOUT
from scex_sumo.learned.network.architecture import Architecture, shapes
from scex_sumo.learned.network.weights import save_weights
from tests.fuzz.mutations import VALUES, mutated

EXECUTED = "executed"
"""A file that a pickle makes where it is run."""


class _Evil:
    def __reduce__(self) -> tuple[Any, ...]:
        return os.mkdir, (EXECUTED,)


EVIL = pickle.dumps({"format": _Evil()})


def write_mutated(file: Path, rng: Random) -> str:
    """Write a small network's weights, mutated; says how."""
    sizes, drawn = Architecture(hidden=8, layers=1, heads=1), np.random.default_rng(0)
    state = {name: drawn.uniform(-0.3, 0.3, shape) for name, shape in shapes("graph", sizes).items()}
    state |= {name: np.ones_like(values) for name, values in state.items() if name.endswith(".spread")}
    save_weights(file, "graph", sizes, state, {})
    what = rng.choice(("bytes", "header", "header", "architecture", "state", "pickle", "outside"))
    if what == "bytes":
        return mutated(file, rng)
    if what == "pickle":
        file.write_bytes(EVIL)
        return what
    if what == "outside":
        return _header(file, rng)
    with safetensors.safe_open(file, framework="numpy") as opened:
        about = json.loads(opened.metadata()[ABOUT])
    arrays: dict[str, Any] = safetensors.numpy.load_file(file)
    at = {"header": about, "architecture": about["architecture"], "state": arrays}[what]
    key = rng.choice(sorted(at))
    if rng.random() < 0.2:
        del at[key]
    elif what == "state":
        wrong = (np.full_like(at[key], np.nan), np.zeros(3, np.float32), np.zeros(0), at[key].astype(np.int8))
        at[key] = rng.choice(wrong)
    else:
        at[key] = rng.choice((*VALUES, 2**20, 2**31, [1] * 999))
    file.write_bytes(safetensors.numpy.save(arrays, {ABOUT: json.dumps(about)}))
    return f"{what} {key}"


def _header(file: Path, rng: Random) -> str:
    """Change what the file says of one array's place, shape or type."""
    content = file.read_bytes()
    length = int.from_bytes(content[:8], "little")
    header = json.loads(content[8 : 8 + length])
    name, key = rng.choice(sorted(header)), rng.choice(("dtype", "shape", "data_offsets"))
    header[name][key] = rng.choice((*VALUES, "F64", [2**40], [0, 2**62], [2**32, 2**32, 2**32]))
    text = json.dumps(header).encode()
    file.write_bytes(len(text).to_bytes(8, "little") + text + content[8 + length :])
    return f"outside {name} {key}"
