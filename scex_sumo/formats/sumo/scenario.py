"""SUMO configuration as a map and a recording: SUMO simulates the user's own scenario."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from scex_sumo.base.errors import MapError, SimulationError, TrackError
from scex_sumo.base.files import TemporaryFolder
from scex_sumo.base.programs import program, user_sumo
from scex_sumo.base.progress import Progress
from scex_sumo.converters.naming import map_name
from scex_sumo.converters.registries import Dataset, MapFormat, Recording
from scex_sumo.converters.tracks.rows import TrackTable
from scex_sumo.extrapolation.workers import in_other_process
from scex_sumo.formats.sumo.net import read_sumo_road
from scex_sumo.formats.sumo.private import PrivateRun, net_of
from scex_sumo.formats.sumo.recorder import Recorded, Recorder
from scex_sumo.road import Road
from scex_sumo.world.session import load_sumo, silence

WITHOUT_END_S = 600.0  # simulated if neither a time is given nor the configuration has an end
_QUIET = ("--no-step-log", "true", "--duration-log.disable", "true", "--xml-validation", "never")
SUBLANE = "the sublane model simulated it; futures with SUMO drivers keep to the middle of their lanes"

Window = tuple[float | None, float | None]


def is_scenario(path: Path) -> bool:
    """Whether a path is a configuration of SUMO, by its name."""
    return str(path).lower().endswith((".sumocfg", ".sumocfg.xml", ".sumo.cfg"))


def simulate(
    config: Path, window: Window = (None, None), on_step: Callable[[int], None] = lambda permille: None
) -> Recorded:
    """Simulate a configuration in this process and record a part of it; no file of it is written.

    SUMO is libsumo, or the user's own build that ``SUMO_HOME`` names, over TraCI.

    Args:
        window: first and last time, s; None is the simulation's begin and end.
        on_step: called now and then with the simulated thousandths of the time.

    Raises:
        MapError: the configuration or a file of it cannot be read.
        SimulationError: SUMO does not start, or stops.
        TrackError: a mesoscopic simulation, or no vehicle in the window.
    """
    own = user_sumo()
    sumo = load_sumo(gui=own is not None)  # traci
    failed = (sumo.TraCIException, sumo.FatalTraCIError)
    binary = program("sumo") if own is None else str(own)
    with TemporaryFolder() as folder, silence() as messages:
        options = [*PrivateRun(config, Path(folder), binary).options, *_QUIET]
        before = Path.cwd()
        os.chdir(folder)  # where SUMO writes files that are named nowhere
        try:
            sumo.start([binary, *options])
            try:
                recorded = _recorded(config, sumo, window, on_step)
                by = () if own is None else (f"simulated by {sumo.getVersion()[1]} of SUMO_HOME",)
                return dataclasses.replace(recorded, notes=(*recorded.notes, *by))
            finally:
                sumo.close()
        except failed as error:
            said = [line.removeprefix("Error: ") for line in messages() if line.startswith("Error: ")]
            reason = " ".join([*dict.fromkeys(said)][:2]) or str(error)
            raise SimulationError(f"{config}: SUMO stops: {reason.replace(folder + '/', '')}") from None
        finally:
            os.chdir(before)


def _recorded(config: Path, sumo: Any, window: Window, on_step: Callable[[int], None]) -> Recorded:
    refuse_mesoscopic(sumo, config)
    begin, end, step_s = sumo.simulation.getTime(), sumo.simulation.getEndTime(), sumo.simulation.getDeltaT()
    if window[0] is not None and 0 < end < window[0]:
        raise TrackError(f"{config}: ends at {end:g} s; choose an earlier --time")
    end = end if end > 0 else begin + WITHOUT_END_S
    first, last = (begin if window[0] is None else window[0]), (end if window[1] is None else window[1])

    def tell() -> float:
        now = float(sumo.simulation.getTime())
        on_step(int(1000 * (now - begin) / max(last - begin, step_s)))
        return now

    if begin + step_s < (before := first - step_s):
        while (now := tell()) < before - 5e-4:
            sumo.simulationStep(min(before, now + max((last - begin) / 200, step_s)))
    recorder = Recorder(sumo)
    while tell() < last - step_s / 2 and sumo.simulation.getMinExpectedNumber():
        sumo.simulationStep()
        recorder.take()
    recorded = recorder.recorded
    if not any(kind != "pedestrian" for kind, *_ in recorded.users.values()):
        only = "only pedestrians" if recorded.users else "no vehicle"
        raise TrackError(f"{config}: {only} from {first:g} s to {last:g} s; {_first(sumo)}")
    sublane = float(sumo.simulation.getOption("lateral-resolution")) > 0
    return dataclasses.replace(recorded, notes=(SUBLANE,) if sublane else ())


def refuse_mesoscopic(sumo: Any, what: object) -> None:
    """Raise a `TrackError` if a simulation is mesoscopic."""
    if sumo.simulation.getOption("mesosim") == "true":
        raise TrackError(f"{what}: mesoscopic, without positions on lanes; simulate without mesosim")


def _first(sumo: Any) -> str:
    """Say when the first vehicle departs, for as long as it is worth waiting."""
    until = sumo.simulation.getTime() + WITHOUT_END_S
    while sumo.simulation.getTime() < until and sumo.simulation.getMinExpectedNumber():
        sumo.simulationStep()
        if sumo.vehicle.getIDCount():
            return f"a vehicle departs at {sumo.simulation.getTime():g} s; choose a later --time"
    return "no vehicle departs after that; choose an earlier --time"


def _read(
    paths: Sequence[Path],
    *,
    net: Path | None = None,
    window: Window = (None, None),
    progress: Progress | None = None,
) -> tuple[TrackTable, tuple[str, ...]]:
    path = paths[0].absolute()
    recorded = in_other_process(
        partial(simulate, path, window),
        where="in the simulation",
        died=f"{path}: SUMO crashed twice in it",
        on_step=None if progress is None else lambda permille: progress(permille, 1000),
    )
    return recorded.tracks(path)


def _recordings(files: Sequence[Path]) -> Iterator[Recording]:
    for path in files:
        if is_scenario(path):
            name = map_name(path.name.removesuffix(".xml"))
            yield Recording(name=name, site=name, dataset="sumo", map_path=path, track_paths=(path,))


def _read_road(path: str | Path, **_: object) -> Road:
    net = net_of(Path(path))
    if not net.is_file():
        raise MapError(f"{path}: its net {net} does not exist; correct <net-file>")
    return read_sumo_road(net)


SCENARIO = Dataset(is_mine=is_scenario, read=_read, recordings=_recordings, simulated=True)
SCENARIO_MAP = MapFormat(is_mine=is_scenario, read=_read_road, tracks=lambda path: path)
