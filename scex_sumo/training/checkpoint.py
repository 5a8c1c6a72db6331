"""Checkpoints of a training run: written after every epoch, and enough to go on as if nothing happened."""

from __future__ import annotations

import io
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
import torch

from scex_sumo.errors import ResultError
from scex_sumo.files import write_atomic
from scex_sumo.training.data.samples import TrainingSamples

FILE = "checkpoint.pt"


@dataclass(frozen=True, kw_only=True)
class Checkpoint:
    """Where a run is.

    Attributes:
        identity: of the run: samples and options.
        epoch: epochs done.
        seconds: of training so far.
        best_epoch: epoch of the best validation.
        best_loss: its loss.
        net: weights.
        mean: their running mean.
        best: the best of these.
        optimizer: its state.
        rounds: rounds in closed loop done, whose samples lie beside.
    """

    identity: dict[str, Any]
    epoch: int
    seconds: float
    best_epoch: int
    best_loss: float
    net: dict[str, Any]
    mean: dict[str, Any]
    best: dict[str, Any]
    optimizer: dict[str, Any]
    rounds: int


def write_checkpoint(folder: Path, checkpoint: Checkpoint, drifted: list[TrainingSamples]) -> None:
    """Write a checkpoint, and the samples of rounds in closed loop that are not there yet."""
    folder.mkdir(parents=True, exist_ok=True)
    for number, samples in enumerate(drifted):
        file = folder / f"round{number}.npz"
        if not file.exists():
            buffer = io.BytesIO()
            np.savez(buffer, **vars(samples))
            write_atomic(file, buffer.getvalue())
    buffer = io.BytesIO()
    torch.save({f.name: getattr(checkpoint, f.name) for f in fields(Checkpoint)}, buffer)
    write_atomic(folder / FILE, buffer.getvalue())


def read_checkpoint(
    folder: Path, identity: dict[str, Any]
) -> tuple[Checkpoint, list[TrainingSamples]] | None:
    """The checkpoint of a folder and the samples of its rounds; None where there is none.

    Raises:
        ResultError: the checkpoint cannot be read, or is that of another run.
    """
    file = folder / FILE
    if not file.exists():
        return None
    try:
        checkpoint = Checkpoint(**torch.load(file, map_location="cpu", weights_only=True))
    except Exception as error:  # torch raises whatever its unpickler meets
        raise ResultError(
            f"{file}: not a checkpoint of this version ({type(error).__name__}); train without --resume"
        ) from None
    other = sorted(key for key in identity if checkpoint.identity.get(key) != identity[key])
    if other:
        raise ResultError(
            f"{file}: a checkpoint of a run with another {', '.join(other)}; give the same options and data, "
            "or train without --resume"
        )
    drifted = []
    for number in range(checkpoint.rounds):
        with np.load(folder / f"round{number}.npz") as data:
            columns: dict[str, Any] = {name: data[name] for name in data.files}
            drifted.append(TrainingSamples(**columns))
    return checkpoint, drifted
