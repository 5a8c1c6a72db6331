"""External driving function: a program in any language that answers lines of JSON.

It reads one line per question and answers with one line. The first line is the road; any JSON object as
answer means that the program is ready.
"""

from __future__ import annotations

import json
import os
import selectors
import shlex
import subprocess
import time
from typing import Any

import numpy as np

from scex_sumo.base.errors import ScexError, UsageError
from scex_sumo.behaviors.base import PLAN_STEPS
from scex_sumo.behaviors.plug_in.user_model import EMPTY, UserModel
from scex_sumo.road import Road
from scex_sumo.scene import STEP_S, SceneHistory, States

NAME = "process"
START_S = 30.0  # time for a program to get ready
MAX_STARTS = 5  # of one program in one worker
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
            raise UsageError(f"{NAME}: needs a command, as in {NAME}:'python driver.py'")
        if not deadline_s > 0:
            raise UsageError(f"{NAME}: deadline_s={deadline_s:g}: needs more than 0 s")
        self.command, self.deadline_s = command, deadline_s
        self._program: _Program | None = None
        self._starts = 0

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_program": None, "_starts": 0}  # each worker starts its own

    def plan_one(
        self, history: SceneHistory, road: Road, child: int, vehicle: int, rng: np.random.Generator
    ) -> States:
        """Ask the program; raise a `ScexError` if it gives no plan in time."""
        if self._program is None:
            if self._starts >= MAX_STARTS:
                raise ScexError(
                    f"{self.command}: the program ended or missed its deadline {MAX_STARTS} times; "
                    "it is not started again"
                )
            self._starts += 1
            self._program = _Program(self.command, _setup(road))
        try:
            answer = self._program.ask(_question(history, child, vehicle), self.deadline_s)
        except ScexError:
            self._program.end()
            self._program = None
            raise
        return _states(self.command, answer)


class _Program:
    def __init__(self, command: str, setup: str) -> None:
        self._command = command
        try:
            self._process = subprocess.Popen(
                shlex.split(command), stdin=subprocess.PIPE, stdout=subprocess.PIPE, bufsize=0
            )
        except OSError as error:
            raise ScexError(f"{command}: cannot be started: {error.strerror or error}") from None
        assert self._process.stdin is not None and self._process.stdout is not None
        self._in, self._out = self._process.stdin, self._process.stdout
        os.set_blocking(self._in.fileno(), False)  # a program that does not read must not stop the run
        self._ready, self._selector = selectors.DefaultSelector(), selectors.DefaultSelector()
        self._ready.register(self._in, selectors.EVENT_WRITE)
        self._selector.register(self._out, selectors.EVENT_READ)
        try:
            self.ask(setup, START_S)
        except ScexError:
            self.end()
            raise

    def ask(self, line: str, deadline_s: float) -> Any:
        """Send a line and read one."""
        until = time.monotonic() + deadline_s
        late = ScexError(f"{self._command}: no answer within {deadline_s:g} s")
        left = memoryview(f"{line}\n".encode())
        try:
            while left:
                if not _wait(self._ready, until):
                    raise late
                left = left[os.write(self._in.fileno(), left) :]
        except OSError:
            raise ScexError(f"{self._command}: the program has ended{self._status()}") from None
        read = b""
        while b"\n" not in read[-_PIPE:]:
            if not _wait(self._selector, until):
                raise late
            part = os.read(self._out.fileno(), _PIPE)
            if not part:
                raise ScexError(f"{self._command}: the program has ended{self._status()}")
            read += part
            if len(read) > _MAX_ANSWER:
                raise ScexError(f"{self._command}: answered {_MAX_ANSWER} bytes without the end of a line")
        answer, _, more = read.partition(b"\n")
        if more:
            raise ScexError(f"{self._command}: answered with more than one line: {more[:60]!r}")
        try:
            return json.loads(answer)
        except ValueError:
            raise ScexError(f"{self._command}: its answer is not JSON: {answer[:60]!r}") from None

    def _status(self) -> str:
        try:
            return f" with status {self._process.wait(timeout=0.2)}"
        except subprocess.TimeoutExpired:
            return ""

    def end(self) -> None:
        self._ready.close()
        self._selector.close()
        self._process.kill()
        self._process.wait()
        self._in.close()
        self._out.close()

    def __del__(self) -> None:
        if hasattr(self, "_selector") and not self._out.closed:
            self.end()


def _wait(selector: selectors.BaseSelector, until: float) -> bool:
    left = until - time.monotonic()
    return left > 0 and bool(selector.select(left))


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


def _question(history: SceneHistory, child: int, vehicle: int) -> str:
    scene, states = history.scene, history.states[child]

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
    asked = {"child": int(history.children[child]), "step": history.step}
    return json.dumps({**asked, "vehicle": described(vehicle), "others": others})


def _states(command: str, answer: Any) -> States:
    try:
        rows = {key: np.array(answer[key], dtype=np.float64) for key in _KEYS}
    except (KeyError, TypeError, ValueError):
        keys = ", ".join(_KEYS)
        raise ScexError(
            f"{command}: its answer is not a plan; needs {keys}, {PLAN_STEPS} numbers each"
        ) from None
    if any(row.shape != rows["x"].shape or row.ndim != 1 or len(row) < PLAN_STEPS for row in rows.values()):
        raise ScexError(f"{command}: answered fewer than {PLAN_STEPS} steps, or not as many of each")
    return States(**rows)


PROCESS = UserModel(
    make=ProcessDriver,
    parameters={"command": EMPTY, "deadline_s": 1.0},
    summary="A program of any language, asked by lines of JSON; process:COMMAND.",
)


def split_command(text: str) -> list[str] | None:
    """Split ``process[:deadline_s=S]:COMMAND`` into parameters; return None for other models.

    The command keeps its colons, commas and blanks.
    """
    name, colon, rest = text.partition(":")
    if name.strip() != NAME or not colon:
        return None
    parts = []
    head, colon, after = rest.partition(":")
    if head.startswith("deadline_s=") and colon:
        parts, rest = [head], after
    return [*parts, f"command={rest.removeprefix('command=')}"]
