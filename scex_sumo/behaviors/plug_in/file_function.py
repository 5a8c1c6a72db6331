"""Functions in files: arrays by name in, trajectories out; each process loads the file itself."""

from __future__ import annotations

from abc import ABC, abstractmethod
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray


class FileFunction(ABC):
    """A function in a file.

    Attributes:
        file: its full path.
        inputs: names of what it is called with.
        sizes: of the `Surroundings`, as far as the file fixes them.
    """

    inputs: tuple[str, ...]

    def __init__(self, file: str) -> None:
        self.file = str(Path(file).resolve())
        self.sizes: dict[str, int] = {}

    @cached_property
    @abstractmethod
    def loaded(self) -> Any:
        """What the file holds; an `InputError` where it cannot be loaded."""

    @abstractmethod
    def __call__(self, **arrays: NDArray[Any]) -> NDArray[np.float64]:
        """Trajectories; see `Predictor`."""

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name != "loaded"}
