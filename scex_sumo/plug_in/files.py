"""Models from files: TorchScript and ONNX predictors, and programs in any language that answer lines of JSON.

A program reads one line per question and answers with one line. The first line is the road; any JSON object
as answer means that the program is ready.
"""

from __future__ import annotations

import importlib.util
import json
import os
import selectors
import shlex
import subprocess
import sys
import threading
import time
from dataclasses import asdict
from functools import cached_property, partial
from pathlib import Path
from typing import IO, Any, Final

import numpy as np
from numpy.typing import NDArray

from scex_sumo.base.errors import InputError, MissingExtraError, ScexError, UsageError
from scex_sumo.behaviors.base import PLAN_STEPS
from scex_sumo.behaviors.spec import EMPTY, ModelEntry
from scex_sumo.plug_in.inputs import ARRAYS, Surroundings
from scex_sumo.plug_in.predictor import Predictor
from scex_sumo.road import Road
from scex_sumo.scene import STEP_S, SceneHistory, States

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

PROCESS_NAME = "process"
START_S = 30.0  # time for a program to get ready
QUIET_S = 2.0  # after which a line says that the run waits for it
MAX_STARTS = 5  # of one program in one worker
MAX_COMMAND = 60  # characters of a command in messages
_PIPE = 1 << 16  # bytes that a pipe holds
_MAX_ANSWER = 1 << 22  # bytes; a plan takes 3000
_KEYS = ("x", "y", "heading", "speed")


class ProcessDriver:
    """Single-vehicle model that asks a program.

    Args:
        command: as on a shell's command line, but without a shell.
        deadline_s: a later answer counts as none, and ends the program.
    """

    def __init__(self, command: str, deadline_s: float = 1.0) -> None:
        if not shlex.split(command):
            raise UsageError(f"{PROCESS_NAME}: needs a command, as in {PROCESS_NAME}:'python driver.py'")
        if not deadline_s > 0:
            raise UsageError(f"{PROCESS_NAME}: deadline_s={deadline_s:g}: needs more than 0 s")
        self.command, self.deadline_s = command, deadline_s
        self._program: _Program | None = None
        self._starts = 0
        self._given_up = ""

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_program": None, "_starts": 0}  # each worker starts its own

    def plan_one(
        self, history: SceneHistory, road: Road, future: int, vehicle: int, rng: np.random.Generator
    ) -> States:
        """Ask the program; raise a `ScexError` if it gives no plan in time."""
        if self._given_up:
            raise ScexError(self._given_up)
        if self._program is None:
            if self._starts >= MAX_STARTS:
                raise ScexError(
                    f"the program ended or missed its deadline {MAX_STARTS} times; it is not started again"
                )
            self._starts += 1
            try:
                self._program = _Program(self.command, _setup(road))
            except _NoAnswerError as error:
                self._given_up = str(error)
                raise
        try:
            answer = self._program.ask(_question(history, future, vehicle), self.deadline_s)
        except ScexError:
            self._program.end()
            self._program = None
            raise
        return _states(answer)


class _NoAnswerError(ScexError):
    """No answer in time."""


class _Program:
    def __init__(self, command: str, setup: str) -> None:
        pipe = subprocess.PIPE
        try:
            self._process = subprocess.Popen(
                shlex.split(command), stdin=pipe, stdout=pipe, bufsize=0, start_new_session=True
            )
        except OSError as error:
            raise ScexError(f"the program cannot be started: {error.strerror or error}") from None
        self._end = _end_with_us(self._process.pid)
        assert self._process.stdin is not None and self._process.stdout is not None
        self._in, self._out = self._process.stdin, self._process.stdout
        os.set_blocking(self._in.fileno(), False)  # a program that does not read must not stop the run
        brief = command if len(command) <= MAX_COMMAND else f"{command[:MAX_COMMAND]}..."
        words = f"waiting up to {START_S:g} s for the program {brief}"
        waits = threading.Timer(QUIET_S, partial(print, words, file=sys.stderr))
        waits.start()
        try:
            self.ask(setup, START_S)
        except ScexError as error:
            self.end()
            if isinstance(error, _NoAnswerError):
                error.args = (f"{error}; it must answer the first line with {{}} to be ready",)
            raise
        finally:
            waits.cancel()

    def ask(self, line: str, deadline_s: float) -> Any:
        """Send a line and read one."""
        until = time.monotonic() + deadline_s
        late = _NoAnswerError(f"no answer within {deadline_s:g} s")
        left = memoryview(f"{line}\n".encode())
        try:
            while left:
                if not _wait(self._in, selectors.EVENT_WRITE, until):
                    raise late
                left = left[os.write(self._in.fileno(), left) :]
        except OSError:
            raise ScexError(f"the program has ended{self._status()}") from None
        read, chunk = bytearray(), b""
        while b"\n" not in chunk:
            if not _wait(self._out, selectors.EVENT_READ, until):
                raise late
            chunk = os.read(self._out.fileno(), _PIPE)
            if not chunk:
                raise ScexError(f"the program has ended{self._status()}")
            read += chunk
            if len(read) > _MAX_ANSWER:
                raise ScexError(f"the program answered {_MAX_ANSWER} bytes without the end of a line")
        answer, _, more = bytes(read).partition(b"\n")
        if more:
            raise ScexError(f"the program answered with more than one line: {more[:60]!r}")
        try:
            return json.loads(answer)
        except ValueError:
            raise ScexError(f"its answer is not JSON: {answer[:60]!r}") from None

    def _status(self) -> str:
        try:
            return f" with status {self._process.wait(timeout=0.2)}"
        except subprocess.TimeoutExpired:
            return ""

    def end(self) -> None:
        self._end.communicate()
        self._process.wait()
        self._in.close()
        self._out.close()

    def __del__(self) -> None:
        if hasattr(self, "_out") and not self._out.closed:
            self.end()


def _end_with_us(group: int) -> subprocess.Popen[bytes]:
    """Return a process that kills a process group when its input ends, as it does when this process dies."""
    null, command = subprocess.DEVNULL, f"read x; kill -s KILL -- -{group}"
    words = ["sh", "-c", command]
    return subprocess.Popen(words, stdin=subprocess.PIPE, stdout=null, stderr=null, start_new_session=True)


def _wait(pipe: IO[bytes], event: int, until: float) -> bool:
    with selectors.DefaultSelector() as selector:
        selector.register(pipe, event)
        return (left := until - time.monotonic()) > 0 and bool(selector.select(left))


def _setup(road: Road) -> str:
    lanes = [
        {
            "id": lane.lane_id,
            "centreline": lane.centreline.round(4).tolist(),
            "width": round(lane.width_m, 3),
            "speed_limit": round(lane.speed_limit_mps, 4),
            "successors": list(lane.successors),
            "left": lane.left,
            "right": lane.right,
        }
        for lane in road.vehicle_lanes.values()
    ]
    return json.dumps({"step_s": STEP_S, "plan_steps": PLAN_STEPS, "lanes": lanes})


def _question(history: SceneHistory, future: int, vehicle: int) -> str:
    scene, states = history.scene, history.states[future]

    def described(v: int) -> dict[str, Any]:
        past = states[v]
        return {
            "id": int(scene.track_ids[v]),
            "type": scene.types[v],
            **{key: float(getattr(past, key)[-1]) for key in _KEYS},
            "length": float(scene.length[v]),
            "width": float(scene.width[v]),
            "past": {key: getattr(past, key)[:-1].tolist() for key in _KEYS},
        }

    others = [described(v) for v in range(scene.vehicles) if v != vehicle]
    asked = {"future": int(history.futures[future]), "step": history.step}
    return json.dumps({**asked, "vehicle": described(vehicle), "others": others})


def _states(answer: Any) -> States:
    try:
        columns = {key: np.array(answer[key], dtype=np.float64) for key in _KEYS}
    except (KeyError, TypeError, ValueError):
        keys = ", ".join(_KEYS)
        raise ScexError(f"its answer is not a plan; needs {keys}, {PLAN_STEPS} numbers each") from None
    shape, *others = (values.shape for values in columns.values())
    if len(shape) != 1 or shape[0] < PLAN_STEPS or any(other != shape for other in others):
        raise ScexError(f"the program answered fewer than {PLAN_STEPS} steps, or not as many of each")
    return States(**columns)


def split_command(rest: str) -> list[str]:
    """Split ``[deadline_s=S:]COMMAND`` into parameters; the command keeps its colons, commas and blanks."""
    parts = []
    head, colon, after = rest.partition(":")
    if head.startswith("deadline_s=") and colon:
        parts, rest = [head], after
    return [*parts, f"command={rest.removeprefix('command=')}"]


PROCESS = ModelEntry(
    make=ProcessDriver,
    parameters={"command": EMPTY, "deadline_s": 1.0},
    summary="A program of any language, asked by lines of JSON; process:COMMAND.",
    split=split_command,
    place=320,
)


class _FileFunction:
    """A function in a file: arrays by name in, trajectories out; each process loads it.

    Attributes:
        sizes: fields of `Surroundings` that the file fixes.
    """

    inputs: tuple[str, ...]

    def __init__(self, file: str) -> None:
        self.file = str(Path(file).resolve())
        self.sizes: dict[str, int] = {}

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name != "loaded"}


class _OnnxFunction(_FileFunction):
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
        import onnxruntime

        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.log_severity_level = 3
        try:
            return onnxruntime.InferenceSession(self.file, options, providers=["CPUExecutionProvider"])
        except Exception as error:  # its errors have no common class
            raise InputError(f"{self.file}: not an ONNX file: {' '.join(str(error).split())}") from None

    def __call__(self, **arrays: NDArray[Any]) -> NDArray[Any]:
        given: dict[str, NDArray[Any]] = {
            key: np.ascontiguousarray(values, self._dtypes[key]) for key, values in arrays.items()
        }
        return np.asarray(self.loaded.run(None, given)[0])


class _ScriptedFunction(_FileFunction):
    """A TorchScript file, run on one thread with float32 numbers."""

    def __init__(self, file: str) -> None:
        super().__init__(file)
        arguments = self.loaded.forward.schema.arguments[1:]  # the first is the module itself
        self.inputs = tuple(str(argument.name) for argument in arguments)

    @cached_property
    def loaded(self) -> Any:
        import torch

        torch.set_num_threads(1)  # the last digits of a sum depend on the number of threads
        try:
            jit: Any = torch.jit
            return jit.load(self.file, map_location="cpu").eval()
        except Exception as error:  # torch has no common class of errors
            first = str(error).strip().splitlines()[:1] or ["no message"]
            raise InputError(f"{self.file}: not a TorchScript file: {first[0]}") from None

    def __call__(self, **arrays: NDArray[Any]) -> NDArray[Any]:
        import torch

        kinds = {name: np.float32 if x.dtype.kind == "f" else x.dtype for name, x in arrays.items()}
        tensors = {n: torch.from_numpy(np.ascontiguousarray(x, kinds[n])) for n, x in arrays.items()}
        try:
            with torch.inference_mode():
                trajectories = self.loaded(**tensors)
        except Exception as error:  # its text is a traceback of the network's own code
            last = str(error).strip().splitlines()[-1:] or [type(error).__name__]
            raise ScexError(f"the network raised {last[0]}") from None
        if not isinstance(trajectories, torch.Tensor):
            raise ScexError(f"{Path(self.file).name} returned {type(trajectories).__name__}, needs a tensor")
        return np.asarray(trajectories.numpy())


def _predictor(kind: str, package: str, extra: str, file: str, **surroundings: Any) -> Predictor:
    if importlib.util.find_spec(package) is None:
        how = f"install it with pip install '.[{extra}]' in the clone"
        raise MissingExtraError(f"{kind}: needs {package}; {how}")
    if not Path(file).is_file():
        raise InputError(f"{kind}: file={file}: no such file")
    function = _ScriptedFunction(file) if kind == "torchscript" else _OnnxFunction(file)
    unknown = [name for name in function.inputs if name not in ARRAYS]
    if unknown or not function.inputs:
        asks = f"asks for an input {unknown[0]!r}" if unknown else "has no inputs"
        raise InputError(f"{file}: {asks}; there are: {', '.join(ARRAYS)}")
    around = Surroundings(**(function.sizes | surroundings))
    return Predictor(function, inputs=function.inputs, surroundings=around)


TORCHSCRIPT = ModelEntry(
    make=partial(_predictor, "torchscript", "torch", "learned"),
    parameters={"file": EMPTY, **asdict(Surroundings())},
    summary="A TorchScript file that predicts trajectories; its forward names its inputs.",
    place=300,
)
ONNX = ModelEntry(
    make=partial(_predictor, "onnx", "onnxruntime", "onnx"),
    parameters=TORCHSCRIPT.parameters,
    summary="An ONNX file that predicts trajectories; the names of its inputs say what it is given.",
    place=310,
)
