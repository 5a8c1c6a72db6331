"""Watch of a running SUMO simulation: futures of any of its moments."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any

from scex_sumo.base.errors import ScexError, SimulationError, TrackError, UsageError, warn_notes
from scex_sumo.base.files import TemporaryFolder
from scex_sumo.behaviors import registry as behaviors
from scex_sumo.converters.datasets.reader import repaired
from scex_sumo.converters.naming import map_name
from scex_sumo.converters.registries import Recording
from scex_sumo.evaluation.recordings import LoadedRecording, seed_at
from scex_sumo.extrapolation.extrapolate import extrapolate
from scex_sumo.extrapolation.pool import in_other_process
from scex_sumo.formats.sumo.net import read_sumo_road
from scex_sumo.formats.sumo.recorder import Recorder
from scex_sumo.formats.sumo.scenario import SCENARIO, refuse_mesoscopic
from scex_sumo.metrics import registry as metrics
from scex_sumo.results.run import Run
from scex_sumo.scene import HISTORY_STEPS, STEP_S, SeedScene
from scex_sumo.world.session import load_sumo

_CLOSED = ("FatalTraCIError", "TraCIException", "ConnectionResetError", "BrokenPipeError")


class Watch:
    """Last second of a simulation that somebody else steps, as `watch` makes it.

    Attributes:
        time_s: time of the last recorded step, s.

    Example:
        >>> scex.Watch.extrapolate.__name__
        'extrapolate'
    """

    def __init__(self, connection: Any, net: Path | None) -> None:
        """Record the connection's present step, and each step to come."""
        if not (hasattr(connection, "simulation") and hasattr(connection, "addStepListener")):
            got = getattr(connection, "__name__", type(connection).__name__)
            remedy = "give libsumo, traci or one of its connections"
            raise UsageError(f"scex_sumo.watch: {got} is no connection to SUMO; {remedy}")
        if hasattr(connection, "getConnection"):  # traci itself: its present connection, whatever comes after
            with _asking("read"):
                connection = connection.getConnection(connection.getLabel())
        self._sumo, self._road = connection, None if net is None else read_sumo_road(net)
        with _asking("read"):
            # libtraci steps all of its connections through one module.
            several = getattr(connection, "isLibtraci", bool)()
            self._label = connection.simulation.getLabel() if several else None
            connection.simulation.getTime()  # an error of libsumo without a simulation
            self._step_s = float(connection.simulation.getDeltaT())
            refuse_mesoscopic(connection, "this simulation")
            self._net = net or Path(connection.simulation.getOption("net-file")).absolute()
            self._recorder = Recorder(connection, keep_s=HISTORY_STEPS * STEP_S + self._step_s)
            self.time_s = self._recorder.take()
            connection.addStepListener(self._listener())

    def __repr__(self) -> str:
        users = len(self._recorder.recorded.frames[-1][1])
        return f"Watch({map_name(self._net)!r} at {self.time_s:g} s: {users} road users)"

    def _listener(self) -> Any:
        take = self._take

        class Listener(load_sumo(gui=True).StepListener):  # type: ignore[misc]
            def step(self, t: float = 0.0) -> bool:
                with suppress(Exception):  # the step is the user's; `scene` meets the error again
                    take()
                return True

        return Listener()

    def _is_open(self) -> bool:
        with suppress(SimulationError), _asking("read"):
            self._sumo.simulation.getTime()
            return True
        return False

    def _is_current(self) -> bool:
        return self._label is None or bool(self._sumo.simulation.getLabel() == self._label)

    def _take(self) -> None:
        if self._is_current():
            self.time_s = self._recorder.take()

    def until(self, condition: Callable[[], bool], *, at_most_s: float = 3600.0) -> bool:
        """Step the simulation until a condition holds; return whether it does.

        Args:
            condition: called after each step.
            at_most_s: the simulation's time after which to give up, s; the end of all traffic does so, too.

        Raises:
            SimulationError: the connection is closed, or another one of libtraci is the current one.
        """
        end_s = self.time_s + at_most_s
        while not condition():
            with _asking("step"):
                if not self._is_current():
                    raise SimulationError(f"libtraci steps another connection; switch to {self._label!r}")
                if self.time_s >= end_s or not self._sumo.simulation.getMinExpectedNumber():
                    return False
                self._sumo.simulationStep()
        return True

    def scene(self) -> SeedScene:
        """Return the seed scene of the present step; ``source["vehicles"]`` has SUMO's names.

        It is the last recorded step if the connection is closed.

        Raises:
            TrackError: no vehicle is there.
            MapError: the net cannot be read.
        """
        if self._is_open():
            with _asking("read"):
                self._take()  # steps that no listener was told of, and vehicles removed since
                self._recorder.take_intentions()
        recorded = self._recorder.recorded
        if not any(recorded.users[name][0] != "pedestrian" for name in recorded.frames[-1][1]):
            raise TrackError(f"no vehicle on the road at {self.time_s:g} s; step the simulation first")
        if self._road is None:
            self._road = read_sumo_road(self._net)
        table, findings = repaired(*recorded.tracks(self._net), SCENARIO)
        name = map_name(self._net)
        here = Recording(name=name, site=name, dataset="sumo", map_path=self._net, track_paths=(self._net,))
        loaded = LoadedRecording(recording=here, road=self._road, table=table, findings=findings)
        return seed_at(loaded, float(table.vehicles.stamps_ms[-1]) / 1000.0)

    def extrapolate(self, *, out: str | Path | None = None, **options: Any) -> Run:
        """Simulate futures of the last recorded step in other processes, as `scex_sumo.extrapolate`.

        The watched simulation stays as it is. Notes are `ScexWarning`.

        Args:
            out: result folder; None makes a temporary one that lives as long as the run.
            options: of `scex_sumo.extrapolate`; ``progress`` may be True or None.

        Raises:
            ScexError: as of `scene` and `scex_sumo.extrapolate`.
        """
        if callable(options.get("progress")):
            raise UsageError("progress: the futures run in another process; give True or None")
        scene = self.scene()
        assert scene.road is not None
        warn_notes([*scene.road.notes, *scene.notes])
        temporary = TemporaryFolder() if out is None else None
        folder = Path(temporary.name) / "run" if temporary else Path(str(out)).absolute()
        own = dict(behaviors._registered), dict(metrics._registered)
        run = partial(_extrapolate, scene, folder, options, *own)
        died = f"{folder}: a process of the futures died twice"
        warn_notes(in_other_process(run, where="in the futures", died=died))
        return Run(folder, temporary)


def _extrapolate(
    scene: SeedScene,
    folder: Path,
    options: Mapping[str, Any],
    own_models: Mapping[str, Any],
    own_metrics: Mapping[str, Any],
) -> list[str]:
    behaviors._registered.update(own_models)
    metrics._registered.update(own_metrics)
    run = extrapolate(scene, out=folder, **options)
    return [*run.info["net_notes"], *run.info["run_notes"]]


@contextmanager
def _asking(what: str) -> Iterator[None]:
    try:
        yield
    except ScexError:
        raise
    except Exception as error:
        if type(error).__name__ not in _CLOSED:
            raise
        reason = str(error).rstrip(".")
        raise SimulationError(
            f"cannot {what} the simulation: {reason}; start it before scex_sumo.watch, and close it after"
        ) from None


def watch(connection: Any, *, net: str | Path | None = None) -> Watch:
    """Watch a running SUMO simulation, to extrapolate any of its moments (what-if branching).

    Each step of yours is recorded and the last second kept. The simulation steps as without a watch.

    Args:
        connection: ``libsumo``, ``libtraci``, ``traci`` or a connection of ``traci``, started.
        net: the simulation's net; None asks SUMO, whose path is relative to the folder it was started in.

    Raises:
        UsageError: no connection to SUMO.
        SimulationError: the connection is closed.
        MapError: ``net`` cannot be read.
        TrackError: a mesoscopic simulation.

    Example:
        >>> import libsumo
        >>> try:
        ...     scex.watch(libsumo)
        ... except scex.ScexError as error:
        ...     print(type(error).__name__)
        SimulationError
    """
    return Watch(connection, None if net is None else Path(net))
