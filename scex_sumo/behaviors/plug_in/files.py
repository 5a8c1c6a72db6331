"""Predictors from files: TorchScript and ONNX models as behaviour models."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from pathlib import Path
from typing import Any

from scex_sumo.behaviors.plug_in.inputs import ARRAYS, Surroundings
from scex_sumo.behaviors.plug_in.predictor import Predictor
from scex_sumo.errors import InputError, MissingExtraError


def torchscript(
    *,
    file: str,
    neighbours: int = 16,
    radius: float = 50.0,
    lanes: int = 32,
    points: int = 10,
    spacing: float = 2.0,
) -> Predictor:
    """A TorchScript file that predicts trajectories; its forward names its inputs.

    Args:
        file: as ``torch.jit.save`` wrote it.
        neighbours: K, as in `Surroundings`.
        radius: m.
        lanes: L.
        points: P.
        spacing: m.

    Raises:
        MissingExtraError: torch is not installed.
        InputError: the file is none, or asks for inputs that there are not.
    """
    _there(file, "torchscript", "torch", "learned")
    from scex_sumo.behaviors.plug_in.torchscript_file import ScriptedFunction

    function = ScriptedFunction(file)
    return _predictor(
        function,
        function.inputs,
        file,
        Surroundings(neighbours=neighbours, radius=radius, lanes=lanes, points=points, spacing=spacing),
    )


def onnx(*, file: str, neighbours: int = 0, radius: float = 50.0, lanes: int = 0, points: int = 0,
         spacing: float = 2.0) -> Predictor:  # fmt: skip
    """An ONNX file that predicts trajectories; the names of its inputs say what it is given.

    Args:
        file: ONNX model.
        neighbours: K, as in `Surroundings`; 0 takes what the file declares, else 16.
        radius: m.
        lanes: L; 0 takes what the file declares, else 32.
        points: P; 0 takes what the file declares, else 10.
        spacing: m.

    Raises:
        MissingExtraError: onnxruntime is not installed.
        InputError: the file is none, or asks for inputs that there are not.
    """
    _there(file, "onnx", "onnxruntime", "onnx")
    from scex_sumo.behaviors.plug_in.onnx_file import OnnxFunction

    function = OnnxFunction(file)
    given = {"neighbours": neighbours, "lanes": lanes, "points": points}
    sizes = function.sizes | {name: value for name, value in given.items() if value}
    return _predictor(function, function.inputs, file, Surroundings(radius=radius, spacing=spacing, **sizes))


def _there(file: str, model: str, package: str, extra: str) -> None:
    if importlib.util.find_spec(package) is None:
        raise MissingExtraError(f"{model}: needs {package}; install it with pip install 'scex-sumo[{extra}]'")
    if not Path(file).is_file():
        raise InputError(f"{model}: file={file}: no such file")


def _predictor(
    function: Callable[..., Any], inputs: tuple[str, ...], file: str, surroundings: Surroundings
) -> Predictor:
    unknown = [name for name in inputs if name not in ARRAYS]
    if unknown or not inputs:
        asks = f"asks for an input {unknown[0]!r}" if unknown else "has no inputs"
        raise InputError(f"{file}: {asks}; there are: {', '.join(ARRAYS)}")
    return Predictor(function, inputs=inputs, surroundings=surroundings)
