"""Watch of a running SUMO simulation: futures of any of its moments."""

from __future__ import annotations

import weakref
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any

from scex_sumo.base.arguments import checked
from scex_sumo.base.errors import ScexError, SimulationError, UsageError, warn_notes
from scex_sumo.base.files import TemporaryFolder
from scex_sumo.converters.naming import map_name
from scex_sumo.drivers import registry as behaviors
from scex_sumo.extrapolation.processes.pool import Pool, WorkersDied
from scex_sumo.formats.sumo.recorder import Recorder
from scex_sumo.formats.sumo.scenario import refuse_mesoscopic
from scex_sumo.live.moment import BUSIEST, Focus, Moment, road_of
from scex_sumo.live.risk import Question, Risk
from scex_sumo.live.ticker import Ticker
from scex_sumo.metrics import registry as metrics
from scex_sumo.results.run import Run
from scex_sumo.scene import HISTORY_STEPS, STEP_S, SeedScene
from scex_sumo.steps.extrapolate import extrapolate
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
            with _asking():
                connection = connection.getConnection(connection.getLabel())
        self._sumo = connection
        self._pool: Pool | None = None
        self._end_pool: Callable[[], object] | None = None
        if net is not None:
            road_of(net)  # an error now
        with _asking():
            # libtraci steps all of its connections through one module.
            several = getattr(connection, "isLibtraci", bool)()
            self._label = connection.simulation.getLabel() if several else None
            connection.simulation.getTime()  # an error of libsumo without a simulation
            self._step_s = float(connection.simulation.getDeltaT())
            refuse_mesoscopic(connection, "this simulation")
            self._net = net or Path(connection.simulation.getOption("net-file")).absolute()
            self._recorder = Recorder(connection, keep_s=HISTORY_STEPS * STEP_S + self._step_s)
            self.time_s = self._recorder.take()
            self._ticker: Ticker | None = None
            self._hears = connection.addStepListener(self._listener())

    def __repr__(self) -> str:
        users = len(self._recorder.recorded.frames[-1][1])
        return f"Watch({map_name(self._net)!r} at {self.time_s:g} s: {users} road users)"

    def _listener(self) -> Any:
        take, tick = self._take, self._tick

        class Listener(load_sumo(gui=True).StepListener):  # type: ignore[misc]
            def step(self, t: float = 0.0) -> bool:
                with suppress(Exception):  # the step is the user's; `scene` meets the error again
                    take()
                    tick()
                return True

        return Listener()

    def _is_open(self) -> bool:
        with suppress(SimulationError), _asking():
            self._sumo.simulation.getTime()
            return True
        return False

    def _is_current(self) -> bool:
        return self._label is None or bool(self._sumo.simulation.getLabel() == self._label)

    def _take(self) -> None:
        if self._is_current():
            self.time_s = self._recorder.take()

    def scene(self) -> SeedScene:
        """Return the seed scene of the present step, see `Moment.scene`.

        It is the last recorded step if the connection is closed.
        """
        return self.moment().scene()

    def moment(self, focus: Focus | None = None) -> Moment:
        """Return the last second until the present or last step, with the vehicles of a focus; None: all."""
        is_open = self._is_open()
        if is_open:
            with _asking():
                self._take()  # steps that no listener was told of, and vehicles removed since
        moment = Moment(recorded=self._recorder.recorded, net=self._net)
        if focus is not None:
            moment = moment.within(focus)
        if is_open:
            with _asking():
                self._recorder.take_intentions(None if focus is None else moment.motorised)
        return moment if focus is None else moment.intending(self._recorder.recorded)

    def every(
        self,
        seconds: float,
        callback: Callable[[Risk], object] | None = None,
        *,
        region: tuple[float, float, float] | str | None = None,
        busiest: int = BUSIEST,
        wait: bool = False,
        workers: int = 1,
        **question: Any,
    ) -> None:
        """Assess the simulation every so many seconds of its time, in other processes, while you step it.

        A moment is skipped while all processes work. Whatever fails is a `ScexWarning`; your simulation goes
        on.

        Args:
            callback: called with each `Risk` after one of your steps; it may act on the simulation.
            region: circle, x, y and radius, m; only pairs with a vehicle in it count. Or SUMO's name of a
                vehicle: within 30 m of it.
            busiest: without a region, number of vehicles, in the busiest place.
            wait: no moment is skipped: the simulation waits; with one worker for each moment's risk.
            workers: processes.
            question: fields of `Question`: ``futures``, ``models``, ``seed``.

        Raises:
            UsageError: an option makes no sense.
        """
        focus = Focus(region=region, busiest=busiest)
        settings = Question(**question)
        self._end_ticker()
        self._ticker = Ticker(
            seconds, callback, question=settings, focus=focus, net=self._net, wait=wait, workers=workers
        )

    def risk(self) -> Risk | None:
        """Return the risk of the last moment that is finished; None before the first one."""
        if self._ticker is None:
            return None
        self._ticker.take_up()
        return self._ticker.risk

    @property
    def skipped(self) -> int:
        """Number of moments that `every` skipped, because all processes worked."""
        return 0 if self._ticker is None else self._ticker.skipped

    def get_ready(self) -> None:
        """Wait until the processes of `every` have started, which takes some seconds."""
        if self._ticker is not None:
            self._ticker.get_ready()

    def finish(self) -> None:
        """Wait for the moments that are being assessed."""
        if self._ticker is not None:
            self._ticker.finish()

    def close(self) -> None:
        """End `every` and all processes of this watch; the simulation goes on."""
        self._end_ticker()
        if self._end_pool is not None:
            self._end_pool()
            self._pool = self._end_pool = None

    def _end_ticker(self) -> None:
        if self._ticker is not None:
            self._ticker.close()

    def _tick(self) -> None:
        if self._ticker is not None and self._is_current():
            self._ticker.step(self.time_s, self.moment)

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
        moment = self.moment()
        temporary = TemporaryFolder() if out is None else None
        folder = Path(temporary.name) / "run" if temporary else Path(str(out)).absolute()
        registered = dict(behaviors._registered), dict(metrics._registered)
        work = partial(_extrapolate, moment, folder, options, *registered)
        if self._pool is None:  # kept: the second time it knows net, map and models
            self._pool = Pool(1)
            self._end_pool = weakref.finalize(self, self._pool.close)
        try:
            warn_notes(self._pool.submit(work, where="in the futures").result())
        except WorkersDied as died:
            last = died.args[1][-1]
            raise SimulationError(f"{folder}: a process of the futures died twice ({last})") from None
        return Run(folder, temporary)


def _extrapolate(
    moment: Moment,
    folder: Path,
    options: Mapping[str, Any],
    own_models: Mapping[str, Any],
    own_metrics: Mapping[str, Any],
) -> list[str]:
    behaviors._registered.update(own_models)
    metrics._registered.update(own_metrics)
    scene = moment.scene()
    assert scene.road is not None
    run = extrapolate(scene, out=folder, **options)
    return [*scene.road.notes, *scene.notes, *run.info["net_notes"], *run.info["run_notes"]]


@contextmanager
def _asking() -> Iterator[None]:
    try:
        yield
    except ScexError:
        raise
    except Exception as error:
        if type(error).__name__ not in _CLOSED:
            raise
        reason = str(error).rstrip(".")
        raise SimulationError(
            f"cannot read the simulation: {reason}; start it before scex_sumo.watch, and close it after"
        ) from None


@checked
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
