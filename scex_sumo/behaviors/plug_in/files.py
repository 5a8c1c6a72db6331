"""Models from files: TorchScript and ONNX predictors, and programs."""

from __future__ import annotations

import importlib.util
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import asdict
from functools import cached_property, partial
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from scex_sumo.base.errors import InputError, MissingExtraError, ScexError
from scex_sumo.behaviors.plug_in.inputs import ARRAYS, Surroundings
from scex_sumo.behaviors.plug_in.predictor import Predictor
from scex_sumo.behaviors.plug_in.process import NAME, PROCESS
from scex_sumo.behaviors.plug_in.user_model import EMPTY, UserModel

_DTYPES: Final = {
    "tensor(float)": np.float32,
    "tensor(double)": np.float64,
    "tensor(float16)": np.float16,
    "tensor(int64)": np.int64,
    "tensor(int32)": np.int32,
    "tensor(bool)": np.bool_,
}
# Inputs and axes that fix the sizes of the surroundings.
_SIZES: Final = {
    "neighbours": (("neighbours", 1), ("neighbour_size", 1), ("neighbour_kind", 1), ("neighbour_mask", 1)),
    "lanes": (("lanes", 1), ("lane_limit", 1), ("lane_mask", 1)),
    "points": (("lanes", 2),),
}


class FileFunction(ABC):
    """A function in a file: arrays by name in, trajectories out; each process loads it.

    Attributes:
        sizes: fields of `Surroundings` that the file fixes.
    """

    inputs: tuple[str, ...]

    def __init__(self, file: str) -> None:
        self.file = str(Path(file).resolve())
        self.sizes: dict[str, int] = {}

    @cached_property
    @abstractmethod
    def loaded(self) -> Any:
        """Content of the file."""

    @abstractmethod
    def __call__(self, **arrays: NDArray[Any]) -> NDArray[np.float64]:
        """Return trajectories; see `Predictor`."""

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name != "loaded"}


class OnnxFunction(FileFunction):
    """An ONNX file, run on one thread; its first output holds the trajectories."""

    def __init__(self, file: str) -> None:
        super().__init__(file)
        declared = self.loaded.get_inputs()
        self.inputs = tuple(entry.name for entry in declared)
        self._dtypes = {entry.name: _DTYPES.get(entry.type, np.float32) for entry in declared}
        shapes = {entry.name: list(entry.shape) for entry in declared}
        fixed = next((name for name, shape in shapes.items() if shape and isinstance(shape[0], int)), None)
        if fixed is not None:
            raise InputError(
                f"{file}: input {fixed} has shape {shapes[fixed]}, for {shapes[fixed][0]} vehicles only; "
                "export it with a free first dimension (dynamic_axes or dynamic_shapes)"
            )
        for size, places in _SIZES.items():
            for name, axis in places:
                shape = shapes.get(name, [])
                if len(shape) > axis and isinstance(shape[axis], int):
                    self.sizes[size] = shape[axis]

    @cached_property
    def loaded(self) -> Any:
        """The inference session."""
        import onnxruntime

        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = 1
        options.inter_op_num_threads = 1
        options.log_severity_level = 3
        try:
            return onnxruntime.InferenceSession(self.file, options, providers=["CPUExecutionProvider"])
        except Exception as error:  # its errors have no common class
            raise InputError(f"{self.file}: not an ONNX file: {' '.join(str(error).split())}") from None

    def __call__(self, **arrays: NDArray[Any]) -> NDArray[np.float64]:
        """Return trajectories."""
        given: dict[str, NDArray[Any]] = {
            key: np.ascontiguousarray(values, self._dtypes[key]) for key, values in arrays.items()
        }
        return np.asarray(self.loaded.run(None, given)[0], dtype=np.float64)


class ScriptedFunction(FileFunction):
    """A TorchScript file, run on one thread with float32 numbers."""

    def __init__(self, file: str) -> None:
        super().__init__(file)
        arguments = self.loaded.forward.schema.arguments[1:]  # the first is the module itself
        self.inputs = tuple(str(argument.name) for argument in arguments)

    @cached_property
    def loaded(self) -> Any:
        """The module."""
        import torch

        torch.set_num_threads(1)  # the last digits of a sum depend on the number of threads
        try:
            jit: Any = torch.jit
            return jit.load(self.file, map_location="cpu").eval()
        except Exception as error:  # torch has no common class of errors
            first = str(error).strip().splitlines()[:1] or ["no message"]
            raise InputError(f"{self.file}: not a TorchScript file: {first[0]}") from None

    def __call__(self, **arrays: NDArray[Any]) -> NDArray[np.float64]:
        """Return trajectories."""
        import torch

        tensors = {
            name: torch.from_numpy(
                np.ascontiguousarray(values, dtype=np.float32 if values.dtype.kind == "f" else values.dtype)
            )
            for name, values in arrays.items()
        }
        with torch.inference_mode():
            made = self.loaded(**tensors)
        if not isinstance(made, torch.Tensor):
            raise ScexError(f"{Path(self.file).name} returned {type(made).__name__}, needs a tensor")
        return np.asarray(made.numpy(), dtype=np.float64)


# Class, required package and its extra.
_KINDS: Mapping[str, tuple[type[FileFunction], str, str]] = {
    "torchscript": (ScriptedFunction, "torch", "learned"),
    "onnx": (OnnxFunction, "onnxruntime", "onnx"),
}


def _predictor(kind: str, file: str, **surroundings: Any) -> Predictor:
    make, package, extra = _KINDS[kind]
    if importlib.util.find_spec(package) is None:
        raise MissingExtraError(f"{kind}: needs {package}; install it with pip install 'scex-sumo[{extra}]'")
    if not Path(file).is_file():
        raise InputError(f"{kind}: file={file}: no such file")
    function = make(file)
    unknown = [name for name in function.inputs if name not in ARRAYS]
    if unknown or not function.inputs:
        asks = f"asks for an input {unknown[0]!r}" if unknown else "has no inputs"
        raise InputError(f"{file}: {asks}; there are: {', '.join(ARRAYS)}")
    around = Surroundings(**(function.sizes | surroundings))
    return Predictor(function, inputs=function.inputs, surroundings=around)


_SUMMARIES = {
    "torchscript": "A TorchScript file that predicts trajectories; its forward names its inputs.",
    "onnx": "An ONNX file that predicts trajectories; the names of its inputs say what it is given.",
}
FILES: Mapping[str, UserModel] = {
    **{
        kind: UserModel(
            make=partial(_predictor, kind),
            parameters={"file": EMPTY, **asdict(Surroundings())},
            summary=summary,
        )
        for kind, summary in _SUMMARIES.items()
    },
    NAME: PROCESS,
}
"""Models from files by name; the file or command is a parameter."""
