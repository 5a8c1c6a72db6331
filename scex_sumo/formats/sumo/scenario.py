"""SUMO configurations and saved states as recordings: SUMO runs them itself, and writes no file."""

from __future__ import annotations

import math
import os
import re
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, redirect_stdout, suppress
from dataclasses import replace
from functools import partial
from io import StringIO
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from scex_sumo.base.errors import MapError, SimulationError, TrackError, one_line
from scex_sumo.base.files import TemporaryFolder
from scex_sumo.base.progress import Progress
from scex_sumo.base.sumo.programs import checked_path, environment, program, sumo_home
from scex_sumo.converters.naming import beginning, map_name, number
from scex_sumo.converters.net.reading import allowed_content
from scex_sumo.converters.registries import Dataset, MapFormat, Window, own_maps
from scex_sumo.converters.tracks.rows import TrackTable
from scex_sumo.converters.xml import is_utf8, unpacked, xml_root
from scex_sumo.extrapolation.processes.pool import in_other_process
from scex_sumo.formats.damage import refusing_damage
from scex_sumo.formats.recognition import is_simulation, is_state
from scex_sumo.formats.sumo.fcd import xml_elements
from scex_sumo.formats.sumo.intentions import INTENTIONS_S
from scex_sumo.formats.sumo.net import read_sumo_road
from scex_sumo.formats.sumo.recorder import Recorded, Recorder
from scex_sumo.formats.sumo.saved import PRECISE
from scex_sumo.road import Road
from scex_sumo.world.session import load_sumo, silence

OLDEST_SUMO = (1, 20)
MAX_SCALE = 100.0  # of the traffic; a larger one loads vehicles for minutes before the first step
MAX_VEHICLES = 20_000  # driving and waiting to be inserted
MAX_FLOW_HZ = 1_000.0  # departures of one flow; SUMO makes those of a step at once
MAX_STEP_S = 60  # processor time of one step
WITHOUT_END_S = 600.0  # simulated if neither a time is given nor the configuration has an end
_TOP = 100_000  # bytes of a saved state that hold its options
_KEPT = ("step-length", "lateral-resolution", "default.carfollowmodel")
QUIET = ("--no-step-log", "true", "--duration-log.disable", "true", "--xml-validation", "never")

SCALE = "scale"
NET, ROUTES, ADDITIONAL, STATE = "net-file", "route-files", "additional-files", "load-state"
_INPUTS = (NET, ROUTES, ADDITIONAL, STATE, "weight-files", "device.fcd-replay.files", "phemlight-path")
_LEFT_OUT = ("configuration", "output", "report", "traci_server", "gui_only", "ssm_device")
_WRITES = r"output|\.file$|^osg-"
_WRITERS = ("file", "output", "dest")  # attributes that name a file to write
_READERS = {"include": "href", "rerouter": "file", "variableSpeedSign": "file"}  # that name one to read
_FLOWS = ("flow", "personFlow", "containerFlow")
_NOWHERE = "NUL"  # SUMO's own word for an output that is not written


def options_of(config: Path) -> dict[str, str]:
    """Read the options of a ``.sumocfg``, by the names in the file.

    Raises:
        MapError: there is no such file, or it cannot be read as a configuration.
    """
    if not config.is_file():
        raise MapError(f"{config}: no such file; check the path of the configuration")
    root = xml_root(config, remedy="name a SUMO configuration")
    if root.tag == "net":
        raise MapError(f"{config}: a SUMO net, no configuration; name it NAME.net.xml")
    options = {}
    for element in root.iter():
        value = element.get("value", element.get("v", "" if len(element) else (element.text or "").strip()))
        if value and element is not root:
            options[element.tag] = value
    return options


def net_of(config: Path) -> Path:
    """Return the path of the net of a ``.sumocfg``."""
    options = options_of(config)
    given = next((options[name] for name in (NET, "net", "n") if name in options), None)
    if given is None:
        raise MapError(f"{config}: no <net-file> in it; give the configuration of a simulation")
    return _files(config, given)[0]


def private_options(config: Path, folder: Path, binary: str, options: Mapping[str, str]) -> list[str]:
    """Return the command line with which SUMO runs a configuration with given options and writes no file.

    Outputs, logs, ports and windows are left out by SUMO's own list of options. Files that name outputs
    (detectors, probes, calibrators, devices) are copied without them into ``folder``.
    """
    known, safe, given = _known_options(binary), dict[Path, Path](), dict[str, str]()
    for name, value in options.items():
        option, section, kind = known.get(name, (name, "", ""))
        if option == SCALE:
            _check_scale(config, value)
        if option in _INPUTS:
            files = [_safe_input(option, file, folder, safe) for file in _files(config, value)]
            given[option] = ",".join(map(checked_path, files))
        elif section not in _LEFT_OUT and kind != "FILE" and not re.search(_WRITES, option):
            given[option] = value
    if NET not in given:
        raise MapError(f"{config}: no <net-file> in it; give the configuration of a simulation")
    given |= {name: value for name, value in PRECISE.items() if name in known}
    return [word for name, value in given.items() for word in (f"--{name}", value)]


def _safe_input(option: str, file: Path, folder: Path, safe: dict[Path, Path]) -> Path:
    if not file.exists():
        raise MapError(f"{file}: no such file; the configuration names it as <{option}>")
    if option == NET:
        content, left_out = allowed_content(file)
        return _copy(file, content, folder) if left_out else file
    return _safe_file(file, folder, safe) if option in (ROUTES, ADDITIONAL, STATE) else file


def _safe_file(file: Path, folder: Path, safe: dict[Path, Path]) -> Path:
    """Return the file, or a copy of it without outputs; ``safe`` has those of other files."""
    file = file.resolve()
    if file not in safe:
        safe[file] = file  # an include that leads back to this file
        if _names_files(file) or not is_utf8(beginning(file)):
            root = xml_root(file, remedy="SUMO needs XML here")
            for element in root.iter():
                for child in [child for child in element if _is_output_parameter(child.tag, child.attrib)]:
                    element.remove(child)
                reads = _READERS.get(element.tag)
                if reads is not None and element.get(reads):
                    inner = file.parent / _expanded(element.attrib[reads])
                    if not inner.exists():
                        raise MapError(f"{inner}: no such file; {file} names it in <{element.tag}>")
                    element.set(reads, str(_safe_file(inner, folder, safe)))
                for name in _WRITERS:
                    if name in element.attrib and name != reads:
                        element.set(name, _NOWHERE)
            safe[file] = _copy(file, ElementTree.tostring(root, encoding="utf-8"), folder)
    return safe[file]


def _copy(file: Path, content: bytes, folder: Path) -> Path:
    copy = folder / f"{len(list(folder.iterdir()))}_{file.name.removesuffix('.gz')}"
    copy.write_bytes(content)
    return copy


def _known_options(binary: str) -> dict[str, tuple[str, str, str]]:
    """Return name, section and type of SUMO's options by each of their names."""
    command = [binary, "--save-template", "-"]
    done = subprocess.run(command, capture_output=True, env=environment(), check=False)
    try:
        sections = ElementTree.fromstring(done.stdout)
    except ElementTree.ParseError:
        raise SimulationError(f"{binary}: does not list its options; install SUMO again") from None
    return {
        name: (option.tag, section.tag, option.get("type", ""))
        for section in sections
        for option in section
        for name in (option.tag, *option.get("synonymes", "").split())
    }


def _check_scale(file: Path, value: str) -> None:
    """Raise a `MapError` for a scale of the traffic that SUMO would not finish to load."""
    try:
        too_large = not float(value) <= MAX_SCALE
    except ValueError:
        return  # SUMO says so
    if too_large:
        raise MapError(f"{file}: scales the traffic by {value}, at most {MAX_SCALE:g} is run; lower scale")


def _check_flow(file: Path, flow: Mapping[str, str]) -> None:
    """Raise a `MapError` for a flow whose departures SUMO would not finish to make within a step."""

    def given(name: str, otherwise: float = math.nan) -> float:
        value = number(flow.get(name, "").strip().removeprefix("exp(").removesuffix(")"))
        return otherwise if math.isnan(value) else value  # SUMO knows other words, and says what is wrong

    rates = [given(name) / 3600 for name in ("vehsPerHour", "personsPerHour", "perHour")]
    if (period := flow.get("period")) is not None:
        rates.append(given("period") if "exp" in period else 1 / max(given("period"), 1e-300))
    else:
        rates.append(given("number") / max(given("end", 86_400.0) - given("begin", 0.0), 1.0))
    if any(rate > MAX_FLOW_HZ for rate in rates):
        raise MapError(
            f"{file}: flow {flow.get('id', '')} has {np.nanmax(rates):.3g} departures a second, at most "
            f"{MAX_FLOW_HZ:,.0f} are run; lower it"
        )


def _files(config: Path, value: str) -> list[Path]:
    names = [name.strip() for name in re.split("[,;]", value) if name.strip()]
    return [(config.parent / _expanded(name)).absolute() for name in names]


def _expanded(name: str) -> str:
    return os.path.expandvars(name) if "${" in name else name


def _is_output_parameter(tag: str, attributes: Mapping[str, str]) -> bool:
    return tag == "param" and re.search("(?i)file|output|ssm", attributes.get("key", "")) is not None


def _names_files(file: Path) -> bool:
    """Whether a file of SUMO's names a file to write, or to read besides."""
    names = False
    with refusing_damage(MapError, file, "XML of SUMO"):
        for event, element in xml_elements(file):
            tag, attributes = element.tag, element.attrib
            if event == "end":
                continue
            if tag == "vType":
                _check_scale(file, attributes.get(SCALE, "1"))
            elif tag in _FLOWS:
                _check_flow(file, attributes)
            names |= tag in _READERS or _is_output_parameter(tag, attributes)
            names |= any(name in attributes for name in _WRITERS)
    return names


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
    return _run(config, options_of(config), lambda sumo: _recorded(config, sumo, window, on_step))


def load_state(state: Path, net: Path) -> Recorded:
    """Let SUMO load a saved state in this process, and record it.

    Raises:
        SimulationError: SUMO cannot load it.
        TrackError: a mesoscopic simulation, or no vehicle on the road.
    """
    # SUMO writes the options of the simulation at the top of its state.
    said = re.findall(r'<([\w.-]+) value="([\d.]+)"/>', unpacked(state)[:_TOP].decode("utf-8", "replace"))
    options = {NET: str(net.absolute()), STATE: str(state.absolute())}
    options |= {name: value for name, value in said if name in _KEPT}

    def record(sumo: Any) -> Recorded:
        refuse_mesoscopic(sumo, state)
        recorder = Recorder(sumo)
        recorder.take()
        recorder.take_intentions()
        if not recorder.recorded.frames[0][1]:
            remedy = "save a state of a simulation with traffic"
            raise TrackError(f"{state}: no vehicle on the road in it; {remedy}")
        return recorder.recorded

    return _run(state, options, record)


def _run(config: Path, given: Mapping[str, str], record: Callable[[Any], Recorded]) -> Recorded:
    """Start SUMO with the options of a file that it may read, and record."""
    own = user_sumo()
    sumo = load_sumo(gui=own is not None)  # traci
    binary = program("sumo") if own is None else str(own)
    with TemporaryFolder() as folder, silence() as messages:
        command = [binary, *private_options(config, Path(folder), binary, given), *QUIET]
        with started(sumo, command, config, folder, messages):
            recorded = record(sumo)
            by = () if own is None else (f"simulated by {sumo.getVersion()[1]} of SUMO_HOME",)
            return replace(recorded, notes=(*recorded.notes, *by))


@contextmanager
def started(
    sumo: Any, command: Sequence[str], config: Path, folder: str, messages: Callable[[], list[str]]
) -> Iterator[None]:
    """Start SUMO in a folder, where it writes files that are named nowhere, and close it after the block.

    ``messages`` returns what SUMO has printed. Raises a `SimulationError` if SUMO does not start, or stops.
    """
    before = Path.cwd()
    os.chdir(folder)
    try:
        with redirect_stdout(StringIO()):
            sumo.start(command)
        try:
            yield
        finally:
            with suppress(Exception):  # it is closed
                sumo.close()
    except (sumo.TraCIException, sumo.FatalTraCIError) as error:
        said = [line.removeprefix("Error: ") for line in messages() if line.startswith("Error: ")]
        reason = one_line(" ".join([*dict.fromkeys(said)][:2]) or error)
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

    def step(to_s: float = 0.0) -> None:
        signal.setitimer(signal.ITIMER_PROF, MAX_STEP_S)  # kills: SUMO does not return to Python
        sumo.simulationStep(to_s)
        signal.setitimer(signal.ITIMER_PROF, 0)

    def tell() -> float:
        waiting = len(sumo.simulation.getPendingVehicles())
        if (count := sumo.vehicle.getIDCount() + waiting) > MAX_VEHICLES:
            raise SimulationError(
                f"{config}: {count:,} vehicles at {sumo.simulation.getTime():g} s, {waiting:,} of them wait "
                f"to be inserted; at most {MAX_VEHICLES:,} are run; lower scale, or the flows"
            )
        now = float(sumo.simulation.getTime())
        on_step(int(1000 * (now - begin) / max(last - begin, step_s)))
        return now

    if begin + step_s < (before := first - step_s):
        while (now := tell()) < before - 5e-4:
            step(min(before, now + max((last - begin) / 200, step_s)))
    recorder, asked = Recorder(sumo), -1.0
    while (now := tell()) < last - step_s / 2 and sumo.simulation.getMinExpectedNumber():
        step()
        recorder.take()
        if (now + step_s - first + 1e-6) // INTENTIONS_S != asked:
            recorder.take_intentions()
            asked = (now + step_s - first + 1e-6) // INTENTIONS_S
    recorded = recorder.recorded
    if not any(kind != "pedestrian" for kind, *_ in recorded.users.values()):
        only = "only pedestrians" if recorded.users else "no vehicle"
        raise TrackError(f"{config}: {only} from {first:g} s to {last:g} s; {_first(sumo)}")
    return recorded


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
        endless=f"{path}: SUMO works for more than {MAX_STEP_S} s on one step; look for vehicles with "
        "sizes, speeds or numbers without measure",
        on_step=None if progress is None else lambda permille: progress(permille, 1000),
    )
    return recorded.tracks(path)


def _read_road(path: str | Path, **_: object) -> Road:
    net = net_of(Path(path))
    if not net.is_file():
        raise MapError(f"{path}: its net {net} does not exist; correct <net-file>")
    return read_sumo_road(net)


def _read_saved(paths: Sequence[Path], *, net: Path | None = None) -> tuple[TrackTable, tuple[str, ...]]:
    path = paths[0].absolute()
    if net is None:
        raise TrackError(
            f"{path}: a saved state counts along the lanes of its SUMO net; give that as the map"
        )
    try:
        recorded = in_other_process(
            partial(load_state, path, net), where="in the state", died=f"{path}: SUMO crashed twice in it"
        )
    except (MapError, SimulationError) as error:
        raise TrackError(f"{error}; give the net that was simulated") from None
    return recorded.tracks(path)


SAVED = Dataset(is_mine=is_state, read=_read_saved)
SCENARIO = Dataset(
    is_mine=is_simulation,
    read=_read,
    recordings=own_maps("sumo", lambda path: map_name(path.name.removesuffix(".xml"))),
    simulated=True,
)
SCENARIO_MAP = MapFormat(is_mine=is_simulation, read=_read_road, tracks=lambda path: path)


def user_sumo() -> Path | None:
    """Return the user's own ``sumo``, in the folder that ``SUMO_HOME`` names; None for the wheel's.

    Raises:
        SimulationError: it is older than 1.20, or does not run.
    """
    home = os.environ.get("SUMO_HOME")
    own = Path(home or "") / "bin" / ("sumo.exe" if sys.platform == "win32" else "sumo")
    if not home or Path(home).resolve() == sumo_home().resolve() or not own.is_file():
        return None
    remedy = "set SUMO_HOME to another one, or unset it"
    try:
        done = subprocess.run([own, "--version"], capture_output=True, text=True, check=False, timeout=20)
    except (OSError, subprocess.TimeoutExpired) as error:
        raise SimulationError(f"{own}: does not run ({error}); {remedy}") from None
    version = re.search(r"\b(\d+)\.(\d+)", done.stdout)
    if version is None or tuple(map(int, version.groups())) < OLDEST_SUMO:
        got = f"version {version[0]}" if version else "of no known version"
        raise SimulationError(f"{own}: {got}; needs {'.'.join(map(str, OLDEST_SUMO))} or newer; {remedy}")
    return own
