"""Session: SUMO runs a user's configuration, writes none of its files, and is watched until it ends."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

from scex_sumo.base.errors import ScexError
from scex_sumo.base.files import TemporaryFolder, writing
from scex_sumo.base.sumo.programs import program
from scex_sumo.commands.console import PrintableStream
from scex_sumo.formats.sumo.scenario import QUIET, net_of, options_of, private_options, started, user_sumo
from scex_sumo.live.painter import TEXT_PX, Painter
from scex_sumo.live.risk import Risk
from scex_sumo.live.watch import Watch
from scex_sumo.world.drawings import WINDOW_SIZE, frame_of, write_view_settings
from scex_sumo.world.session import load_sumo, silence
from scex_sumo.world.tiles import template_of

Receiver: TypeAlias = Callable[[Risk], object]
Begin: TypeAlias = Callable[[Watch, Receiver], object]


@dataclass(frozen=True, kw_only=True)
class Session:
    """What a configuration is watched with: sumo-gui over TraCI, not faster than the clock, or libsumo.

    It is simulated without a watch until ``begin_s`` (None: the begin), and ends at ``end_s`` (None: as
    configured, or with all traffic).
    """

    config: Path
    out: Path
    gui: bool = False
    begin_s: float | None = None
    end_s: float | None = None
    follow: bool = False

    def __post_init__(self) -> None:
        for name in ("config", "out"):  # SUMO runs in another folder
            object.__setattr__(self, name, getattr(self, name).absolute())

    def run(self, begin: Begin, report: Receiver) -> str | None:
        """Run the simulation; return why it ended early, None if it did not.

        It calls ``begin`` with a watch and a callback, ``report`` with each risk. Raises a `MapError` if a
        file cannot be read, a `SimulationError` if SUMO does not start.
        """
        user_binary = user_sumo()
        name = "sumo-gui" if self.gui else "sumo"
        if user_binary is None:
            binary = program(name)
        else:
            binary = str(user_binary.with_name(user_binary.name.replace("sumo", name)))
        sumo = load_sumo(gui=self.gui or user_binary is not None)
        with TemporaryFolder() as folder, _messages() as messages:
            options = private_options(self.config, Path(folder), binary, options_of(self.config))
            command = [binary, *options, *QUIET, "--no-warnings", "true"]
            command += self._window(Path(folder)) if self.gui else []
            with writing(self.out):
                self.out.mkdir(parents=True, exist_ok=True)
            with started(sumo, command, self.config, folder, messages):
                return self._watched(sumo, begin, report)

    def _watched(self, sumo: Any, begin: Begin, report: Receiver) -> str | None:
        failed = (sumo.TraCIException, sumo.FatalTraCIError, OSError)
        before_s = (self.begin_s or 0.0) - sumo.simulation.getDeltaT()
        if before_s > sumo.simulation.getTime():
            sumo.simulationStep(before_s)
        watch = Watch(sumo, net_of(self.config))
        painter = Painter(sumo, follow=self.follow) if self.gui else None

        def take(risk: Risk) -> None:
            report(risk)
            if painter is not None:
                painter(risk)

        begin(watch, take)
        early = None
        try:
            watch.get_ready()
            self._steps(sumo, watch, painter)
        except KeyboardInterrupt:
            early = f"stopped at {watch.time_s:g} s"
        except failed as error:
            reason = str(error).rstrip(".").split("\n")[0]
            cause = "the window or the connection was closed" if self.gui else f"SUMO stopped: {reason}"
            early = f"{cause} at {watch.time_s:g} s"
        with suppress(KeyboardInterrupt, ScexError):
            watch.finish()
        if painter is not None:
            painter.close()
        watch.close()
        return early

    def _steps(self, sumo: Any, watch: Watch, painter: Painter | None) -> None:
        end_s = sumo.simulation.getEndTime() if self.end_s is None else self.end_s
        start_s, first_s = time.perf_counter(), watch.time_s
        while sumo.simulation.getMinExpectedNumber() and not 0 < end_s <= watch.time_s + 1e-6:
            sumo.simulationStep()
            if painter is not None:
                painter.step()
            if self.gui:
                early_s = watch.time_s - first_s - (time.perf_counter() - start_s)
                if early_s > 0:
                    time.sleep(early_s)
                else:  # time that is lost is not made up for
                    start_s -= early_s

    def _window(self, folder: Path) -> list[str]:
        frame = frame_of(template_of(net_of(self.config)).bounds, [(0, 0)], [])
        settings = folder / "view.xml"
        near = self.follow  # outlines of vehicles have their true size
        write_view_settings(settings, frame, delay_ms=0, lights=True, text_px=TEXT_PX, true_size=near)
        shown = ["--gui-settings-file", str(settings), "--window-size", WINDOW_SIZE]
        return [*shown, "--start", "--quit-on-end"]


@contextmanager
def _messages() -> Iterator[Callable[[], list[str]]]:
    """Keep what SUMO's library prints away from the terminal; ours still goes there."""
    out, error = sys.stdout, PrintableStream(os.fdopen(os.dup(2), "w", buffering=1))
    with silence() as messages, redirect_stdout(out), redirect_stderr(error):
        yield messages
