"""Models of files: TorchScript and ONNX predictors, and programs, as behaviour models."""

from __future__ import annotations

import importlib.util
import inspect
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from scex_sumo.behaviors.plug_in.file_function import FileFunction
from scex_sumo.behaviors.plug_in.inputs import ARRAYS, Surroundings
from scex_sumo.behaviors.plug_in.predictor import Predictor
from scex_sumo.behaviors.plug_in.process import NAME, PROCESS
from scex_sumo.behaviors.plug_in.user_model import UserModel
from scex_sumo.errors import InputError, MissingExtraError

_PACKAGES = {"torchscript": ("torch", "learned"), "onnx": ("onnxruntime", "onnx")}  # needed, and its extra


def _predictor(kind: str, file: str, surroundings: Mapping[str, Any]) -> Predictor:
    """The predictor in a file; how much it sees is as given, else as the file says, else the default.

    Raises:
        MissingExtraError: what it needs is not installed.
        InputError: the file is none, or asks for inputs that there are not.
    """
    package, extra = _PACKAGES[kind]
    if importlib.util.find_spec(package) is None:
        raise MissingExtraError(f"{kind}: needs {package}; install it with pip install 'scex-sumo[{extra}]'")
    if not Path(file).is_file():
        raise InputError(f"{kind}: file={file}: no such file")
    function: FileFunction
    if kind == "onnx":
        from scex_sumo.behaviors.plug_in.onnx_file import OnnxFunction

        function = OnnxFunction(file)
    else:
        from scex_sumo.behaviors.plug_in.torchscript_file import ScriptedFunction

        function = ScriptedFunction(file)
    unknown = [name for name in function.inputs if name not in ARRAYS]
    if unknown or not function.inputs:
        asks = f"asks for an input {unknown[0]!r}" if unknown else "has no inputs"
        raise InputError(f"{file}: {asks}; there are: {', '.join(ARRAYS)}")
    around = Surroundings(**(function.sizes | dict(surroundings)))
    return Predictor(function, inputs=function.inputs, surroundings=around)


def _model(kind: str, summary: str) -> UserModel:
    def make(file: str, **surroundings: Any) -> Predictor:
        return _predictor(kind, file, surroundings)

    parameters = {"file": inspect.Parameter.empty, **asdict(Surroundings())}
    return UserModel(make=make, parameters=parameters, summary=summary)


FILES: Mapping[str, UserModel] = {
    "torchscript": _model(
        "torchscript", "A TorchScript file that predicts trajectories; its forward names its inputs."
    ),
    "onnx": _model(
        "onnx", "An ONNX file that predicts trajectories; the names of its inputs say what it is given."
    ),
    NAME: PROCESS,
}
"""Models from files by the name that they have on the command line; the file or command is a parameter."""
