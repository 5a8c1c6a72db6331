"""A TorchScript file as a function of named arrays."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from scex_sumo.errors import InputError, ScexError


class ScriptedFunction:
    """Calls the forward of a TorchScript file: arrays in and out, numbers as float32, one thread.

    Another process loads the file again.
    """

    def __init__(self, file: str) -> None:
        """Load the file.

        Raises:
            InputError: it is no TorchScript file.
        """
        self.file = str(Path(file).resolve())
        self._module: torch.jit.ScriptModule | None = None
        arguments = self.module.forward.schema.arguments[1:]  # the first is the module itself
        self.inputs = tuple(str(argument.name) for argument in arguments)

    @property
    def module(self) -> Any:
        """The loaded file."""
        if self._module is None:
            torch.set_num_threads(1)  # the last digits of a sum depend on the number of threads
            try:
                jit: Any = torch.jit
                self._module = jit.load(self.file, map_location="cpu").eval()
            except Exception as error:  # torch raises RuntimeError, ValueError and others for a foreign file
                first = str(error).strip().splitlines()[:1] or ["no message"]
                raise InputError(f"{self.file}: no TorchScript file: {first[0]}") from None
        return self._module

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_module": None}

    def __call__(self, **arrays: NDArray[Any]) -> NDArray[np.float64]:
        """Trajectories; see `Predictor`."""
        given = {name: _tensor(values) for name, values in arrays.items()}
        with torch.inference_mode():
            made = self.module(**given)
        if not isinstance(made, torch.Tensor):
            raise ScexError(f"{Path(self.file).name} returned {type(made).__name__}, needs a tensor")
        return np.asarray(made.numpy(), dtype=np.float64)


def _tensor(values: NDArray[Any]) -> torch.Tensor:
    kind = np.float32 if values.dtype.kind == "f" else values.dtype
    return torch.from_numpy(np.ascontiguousarray(values, dtype=kind))
