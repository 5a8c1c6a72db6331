"""Files of weights that lie: headers changed, tensors of other shapes, pickles that would run code."""

from __future__ import annotations

import io
import os
import pickle
from pathlib import Path
from random import Random
from typing import Any

import torch

from scex_sumo.behaviors.learned.networks.graph import Architecture, GraphPredictorNet
from scex_sumo.behaviors.learned.weights import COLUMNS, save_weights
from tests.fuzz.mutations import VALUES, mutated

EXECUTED = "executed"
"""A file that a pickle makes where it is run."""


class _Evil:
    def __reduce__(self) -> tuple[Any, ...]:
        return os.mkdir, (EXECUTED,)


def write_mutated(file: Path, rng: Random) -> str:
    """Write a small network's weights, mutated; says how."""
    sizes = {"node_columns": len(COLUMNS["node"]), "edge_columns": len(COLUMNS["edge"])}
    torch.manual_seed(0)
    save_weights(file, GraphPredictorNet(Architecture(**sizes, hidden=8, layers=1, heads=1)), {})
    what = rng.choice(("bytes", "header", "header", "architecture", "state", "pickle"))
    if what == "bytes":
        return mutated(file, rng)
    if what == "pickle":
        file.write_bytes(pickle.dumps({"format": _Evil()}))
        return what
    content = torch.load(file, weights_only=True)
    at = content if what == "header" else content[what]
    key = rng.choice(sorted(at))
    if rng.random() < 0.2:
        del at[key]
    elif what == "state":
        at[key] = rng.choice((torch.full_like(at[key], torch.nan), torch.zeros(3), torch.zeros(0), 1.0, None))
    else:
        at[key] = rng.choice((*VALUES, 2**20, 2**31, [1] * 999))
    buffer = io.BytesIO()
    torch.save(content, buffer)
    file.write_bytes(buffer.getvalue())
    return f"{what} {key}"
