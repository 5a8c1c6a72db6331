"""ONNX files as functions of named arrays: the one module that imports onnxruntime."""

from __future__ import annotations

from functools import cached_property
from typing import Any, Final

import numpy as np
import onnxruntime
from numpy.typing import NDArray

from scex_sumo.behaviors.plug_in.file_function import FileFunction
from scex_sumo.errors import InputError

_DTYPES: Final = {
    "tensor(float)": np.float32,
    "tensor(double)": np.float64,
    "tensor(float16)": np.float16,
    "tensor(int64)": np.int64,
    "tensor(int32)": np.int32,
    "tensor(bool)": np.bool_,
}
# Where the sizes of the surroundings stand in the shapes of the inputs.
_SIZES: Final = {
    "neighbours": (("neighbours", 1), ("neighbour_size", 1), ("neighbour_kind", 1), ("neighbour_mask", 1)),
    "lanes": (("lanes", 1), ("lane_limit", 1), ("lane_mask", 1)),
    "points": (("lanes", 2),),
}


class OnnxFunction(FileFunction):
    """Calls an ONNX file on one thread; its first output are the trajectories."""

    def __init__(self, file: str) -> None:
        """Load the file.

        Raises:
            InputError: it is no ONNX file, or takes only so many vehicles at once.
        """
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
        """The session."""
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = 1
        options.inter_op_num_threads = 1
        options.log_severity_level = 3
        try:
            return onnxruntime.InferenceSession(self.file, options, providers=["CPUExecutionProvider"])
        except Exception as error:  # its errors have no common class
            raise InputError(f"{self.file}: no ONNX file: {' '.join(str(error).split())}") from None

    def __call__(self, **arrays: NDArray[Any]) -> NDArray[np.float64]:
        """Trajectories; see `Predictor`."""
        given: dict[str, NDArray[Any]] = {
            key: np.ascontiguousarray(values, self._dtypes[key]) for key, values in arrays.items()
        }
        return np.asarray(self.loaded.run(None, given)[0], dtype=np.float64)
