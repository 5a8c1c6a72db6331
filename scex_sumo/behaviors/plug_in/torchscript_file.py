"""TorchScript files as functions of named arrays."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from scex_sumo.behaviors.plug_in.file_function import FileFunction
from scex_sumo.errors import InputError, ScexError


class ScriptedFunction(FileFunction):
    """Calls the forward of a TorchScript file on one thread; numbers are float32."""

    def __init__(self, file: str) -> None:
        """Load the file.

        Raises:
            InputError: it is no TorchScript file.
        """
        super().__init__(file)
        arguments = self.loaded.forward.schema.arguments[1:]  # the first is the module itself
        self.inputs = tuple(str(argument.name) for argument in arguments)

    @cached_property
    def loaded(self) -> Any:
        """The module."""
        torch.set_num_threads(1)  # the last digits of a sum depend on the number of threads
        try:
            jit: Any = torch.jit
            return jit.load(self.file, map_location="cpu").eval()
        except Exception as error:  # torch raises RuntimeError, ValueError and others for a foreign file
            first = str(error).strip().splitlines()[:1] or ["no message"]
            raise InputError(f"{self.file}: no TorchScript file: {first[0]}") from None

    def __call__(self, **arrays: NDArray[Any]) -> NDArray[np.float64]:
        """Trajectories; see `Predictor`."""
        with torch.inference_mode():
            made = self.loaded(**{name: _tensor(values) for name, values in arrays.items()})
        if not isinstance(made, torch.Tensor):
            raise ScexError(f"{Path(self.file).name} returned {type(made).__name__}, needs a tensor")
        return np.asarray(made.numpy(), dtype=np.float64)


def _tensor(values: NDArray[Any]) -> torch.Tensor:
    kind = np.float32 if values.dtype.kind == "f" else values.dtype
    return torch.from_numpy(np.ascontiguousarray(values, dtype=kind))
