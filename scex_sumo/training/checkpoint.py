"""Checkpoints of a training run, written after every epoch; a run goes on from one as if uninterrupted."""

from __future__ import annotations

import io
from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np
import torch

from scex_sumo.base.errors import ResultError
from scex_sumo.base.files import write_atomic
from scex_sumo.training.data.samples import TrainingSamples, load_samples

FILE = "checkpoint.pt"


def write_checkpoint(folder: Path, state: dict[str, Any], drifted: list[TrainingSamples]) -> None:
    """Write the state of a run, and the samples of rounds in closed loop that are not there yet."""
    folder.mkdir(parents=True, exist_ok=True)
    for number, samples in enumerate(drifted):
        file = folder / f"round{number}.npz"
        if not file.exists():
            buffer = io.BytesIO()
            np.savez(buffer, **vars(samples))
            write_atomic(file, buffer.getvalue())
    buffer = io.BytesIO()
    torch.save({**state, "rounds": len(drifted)}, buffer)
    write_atomic(folder / FILE, buffer.getvalue())


def read_checkpoint(
    folder: Path, identity: dict[str, Any], entries: Collection[str]
) -> tuple[dict[str, Any], list[TrainingSamples]] | None:
    """Return the state in a folder and the samples of its rounds; None where there is none.

    Raises:
        ResultError: the checkpoint cannot be read, or belongs to another run.
    """
    file = folder / FILE
    if not file.exists():
        return None
    try:
        state: dict[str, Any] = torch.load(file, map_location="cpu", weights_only=True)
        if set(state) != {*entries, "rounds"}:
            raise ValueError
    except Exception as error:  # torch raises whatever its unpickler meets
        raise ResultError(
            f"{file}: not a checkpoint of this version ({type(error).__name__}); train without --resume"
        ) from None
    other = sorted(key for key in identity if state["identity"].get(key) != identity[key])
    if other:
        raise ResultError(
            f"{file}: a checkpoint of a run with another {', '.join(other)}; give the same options and data, "
            "or train without --resume"
        )
    drifted = []
    for number in range(state["rounds"]):
        samples = load_samples(folder / f"round{number}.npz")
        if samples is None:
            raise ResultError(f"{folder}: round{number}.npz cannot be read; train without --resume")
        drifted.append(samples)
    return state, drifted
