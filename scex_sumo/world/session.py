"""SUMO session: files, start, end, errors."""

from __future__ import annotations

import os
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stdout, suppress
from io import StringIO
from pathlib import Path
from typing import Any

from scex_sumo.base.errors import SimulationError
from scex_sumo.base.files import writing
from scex_sumo.scene import STEP_S
from scex_sumo.world.base import WorldRequest
from scex_sumo.world.tiles import TILE_SLOTS, template_of, tile_id
from scex_sumo.world.vehicle_types import TypeBook

ANY_ROUTE = "anywhere"  # moved vehicles never follow it

_GUI_MARGIN_M = 30.0

_OPTIONS = (
    *("--step-length", str(STEP_S), "--seed", "0", "--xml-validation", "never"),
    *("--no-step-log", "true", "--no-warnings", "true", "--duration-log.disable", "true"),
    # SUMO must not remove, stop or push moved vehicles.
    *("--collision.action", "none", "--time-to-teleport", "-1", "--max-depart-delay", "-1"),
    *("--default.speeddev", "0", "--pedestrian.striping.dawdling", "0"),
    *("--save-state.transportables", "true", "--save-state.precision", "12"),
)

_open = False
one_at_a_time = threading.RLock()
"""Held by a thread that uses what a process has once: libsumo, its current folder, standard error."""


def load_sumo(*, gui: bool = False) -> Any:
    """Import libsumo, or traci for sumo-gui."""
    if gui:
        import traci

        return traci
    import libsumo

    return libsumo


@contextmanager
def silence() -> Iterator[Callable[[], list[str]]]:
    """Silence SUMO and traci; yields a function that returns SUMO's messages."""
    with one_at_a_time, tempfile.TemporaryFile() as file, redirect_stdout(StringIO()):

        def messages() -> list[str]:
            file.seek(0)
            return file.read().decode("utf-8", errors="replace").splitlines()

        sys.stderr.flush()
        stream = os.dup(2)
        try:
            os.dup2(file.fileno(), 2)
            yield messages
        finally:
            os.dup2(stream, 2)
            os.close(stream)


class SumoSession:
    """SUMO with the tiles of a net, started when needed and reset to time 0 between batches."""

    def __init__(self, request: WorldRequest, types: TypeBook, folder: Path) -> None:
        """Read the net; ``folder`` is for SUMO's files, drivers may be entered into ``types`` later."""
        self.slots = sorted({int(slot) for slot in request.slots})
        self._request, self._types, self._folder, self._gui = request, types, folder, request.gui
        # Resolution of the sublane model. Without either, SUMO's drivers jump sideways.
        lateral_m = float(request.scene.source.get("lateral_m", 0.0))
        sideways = ("lateral-resolution", lateral_m) if lateral_m else ("lanechange.duration", 3)
        self._sideways = f"--{sideways[0]}", str(sideways[1])
        self._template = tiles = template_of(request.net.path)
        count = max(self.slots, default=0) + 1
        self.layout = tiles.window_layout(count, margin_m=_GUI_MARGIN_M) if self._gui else tiles.layout()
        self._sumo: Any = None
        self._stepped = b""  # the empty state after 0.1 s
        self.errors: tuple[type[Exception], ...] = ()

    def ready(self, module: Any, filled: Callable[[bytes], bytes] | None = None) -> Any:
        """Return libsumo or traci, connected to an empty simulation with all vehicle types.

        Args:
            filled: makes of the empty state, after 0.1 s, the one to begin with.
        """
        if self._sumo is None or not self._types.complete or self._types.random:
            self._begin(module)
        elif filled is None:
            with self.refusals("return to the start"):
                self._sumo.simulation.loadState(str(self._folder / "empty.xml"))
        if filled is not None:
            begin = self._folder / "begin.xml"
            with self.refusals("begin as its simulation does"):
                if not self._stepped:
                    self._sumo.simulation.loadState(str(self._folder / "empty.xml"))
                    self._sumo.simulation.step()
                    self._sumo.simulation.saveState(str(begin))
                    self._stepped = begin.read_bytes()
                begin.write_bytes(filled(self._stepped))
                self._sumo.simulation.loadState(str(begin))
        return self._sumo

    def _begin(self, module: Any) -> None:
        self.stop()
        self._stepped = b""
        # All tiles with all of SUMO's generators (one a lane): a random driver gets the same numbers in its
        # slot.
        self.slots = list(range(TILE_SLOTS)) if self._types.random else self.slots
        generators = self._template.lanes * TILE_SLOTS if self._types.random else 1
        with writing(self._folder):
            options = self._write_files()
        self._start(module, [*options, "--thread-rngs", str(generators)])

    def stop(self) -> None:
        """End the simulation."""
        global _open
        if self._sumo is not None:
            with suppress(*self.errors):
                (self._sumo if self._gui else self._sumo.simulation).close()
            self._sumo, _open = None, False

    @contextmanager
    def refusals(self, what: str) -> Iterator[None]:
        """Turn SUMO's errors into a `SimulationError`: SUMO refused to do ``what``."""
        try:
            yield
        except self.errors as error:
            reason = str(error).strip() or type(error).__name__
            raise SimulationError(f"SUMO refused to {what}: {reason}") from error

    def _write_files(self) -> list[str]:
        if "," in str(self._folder):
            raise SimulationError(f"{self._folder}: SUMO splits paths at commas; set TMPDIR to one without")
        self._folder.mkdir(parents=True, exist_ok=True)
        net, types = self._folder / "tiles.net.xml", self._folder / "types.add.xml"
        self._template.write(net, self.slots, self.layout)
        self._types.write(types)
        additional, options = [types], ["-n", str(net)]
        if self._gui:
            from scex_sumo.world.drawings import write_window

            files = self._request.net.extras, self._folder
            drawn, settings = write_window(
                *files, self._template, self.layout, self.slots, self._request.models
            )
            additional += drawn
            options += [*settings, "--start", "true", "--quit-on-end", "true"]
        return [*options, "-a", ",".join(str(path) for path in additional)]

    def _start(self, module: Any, options: list[str]) -> None:
        global _open
        if _open:
            raise SimulationError("SUMO runs one simulation per process and one is open; close that world")
        if self._gui and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
            raise SimulationError("sumo-gui needs a display and DISPLAY is not set; run without --gui")
        binary = "sumo"
        if self._gui:
            from scex_sumo.base.sumo.programs import program

            binary = program("sumo-gui")
        self.errors = (module.TraCIException, module.FatalTraCIError)
        with silence() as messages:
            try:
                (module if self._gui else module.simulation).start(
                    [binary, *options, *_OPTIONS, *self._sideways]
                )
            except self.errors as error:
                reason = next((line for line in messages() if line.startswith("Error: ")), f"Error: {error}")
                raise SimulationError(f"SUMO does not start: {reason.removeprefix('Error: ')}") from error
        self._sumo, _open = module, True
        edge = self._template.plainest_edge
        with self.refusals("begin"):
            for slot in self.slots:
                module.route.add(tile_id(slot, ANY_ROUTE), [tile_id(slot, edge)])
            module.simulation.saveState(str(self._folder / "empty.xml"))
