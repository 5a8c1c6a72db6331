"""``scex-sumo inspect``: what a recording holds, before a moment of it is run."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Option

from scex_sumo.commands.options import Case, MapPath, Origin, Time, Tracks
from scex_sumo.errors import UsageError

if TYPE_CHECKING:
    from rich.table import Table

    from scex_sumo.converters.datasets.recordings import LoadedRecording, Recording
    from scex_sumo.converters.moments.moments import Moment
    from scex_sumo.scene import SeedScene

EVERY_S = 1.0


def inspect_command(
    map_path: MapPath,
    tracks: Tracks = None,
    case: Case = None,
    time: Time = None,
    origin: Origin = None,
    every: Annotated[float, Option(metavar="S", help="Least time between two moments, s.")] = EVERY_S,
    out: Annotated[
        Path | None, Option("-o", "--out", metavar="FILE.html", help="Write a page with the map as well.")
    ] = None,
) -> None:
    """List the moments of a recording, or the vehicles of one."""
    from rich.console import Console

    from scex_sumo.converters.datasets.recordings import load_recording, recording_moments, seed_at
    from scex_sumo.converters.lanelet.origin import parse_origin
    from scex_sumo.reports.tables.runs import print_line

    if every <= 0:
        raise UsageError(f"--every {every:g}: give a time above 0 s, e.g. --every 1")
    if out is not None and out.suffix != ".html":
        raise UsageError(f"-o {out}: unknown ending; known: .html")
    zero = parse_origin(origin) if origin is not None else None
    loaded = load_recording(_recording(map_path, tracks), zero)
    console = Console(width=None if sys.stdout.isatty() else 110)
    print(f"{loaded.recording.name}: {_size(loaded)}")
    for finding in loaded.findings:
        print_line(f"repaired: {finding}", console)
    words = ["scex-sumo", "run", str(map_path), *(["--tracks", str(tracks)] if tracks else [])]
    words += ["--origin", origin] if origin is not None else []
    moments = recording_moments(loaded, every_s=every)
    if out is not None:
        from scex_sumo.reports.inspection import write_inspection

        print(f"page: {write_inspection(out, loaded, moments, shlex.join(words))}")
    if time is None and case is None:
        console.print(moments_table(moments))
        best = max(moments, key=lambda moment: moment.complete, default=None)
        if best is not None:
            chosen = ["--case", best.case] if best.case else ["--time", f"{best.time_s:g}"]
            print(f"most vehicles: {shlex.join([*words, *chosen])}")
        return
    scene = seed_at(loaded, _time_of(loaded, case) if time is None else time, case=case)
    console.print(_vehicles_table(scene))
    chosen = ["--case", case] if case else ["--time", f"{scene.time_s:g}"]
    print(f"run it: {shlex.join([*words, *chosen])}")


def _recording(map_path: Path, tracks: Path | None) -> Recording:
    """The recording that ``run`` takes with the same options."""
    from scex_sumo.converters.datasets.find import Recording
    from scex_sumo.converters.datasets.seed import recorded_files
    from scex_sumo.converters.moments.scene import recording_name

    paths = recorded_files(map_path, tracks)
    name = recording_name(map_path, paths)
    return Recording(name=name, site="", dataset="", map_path=map_path, track_paths=paths)


def _size(loaded: LoadedRecording) -> str:
    rows = loaded.table.vehicles
    seconds = (int(rows.timestamp_ms.max()) - int(rows.timestamp_ms.min())) / 1000
    return f"{len(set(rows.track_id.tolist()))} vehicles in {seconds:.1f} s"


def _time_of(loaded: LoadedRecording, case: str | None) -> float:
    """The moment of a case, s."""
    from scex_sumo.converters.datasets.recordings import recording_moments

    known = {moment.case: moment.time_s for moment in recording_moments(loaded, every_s=EVERY_S)}
    if case not in known:
        raise UsageError(f"--case {case}: no such case; known: {', '.join(list(known)[:8])}, ...")
    return known[case]


def moments_table(moments: list[Moment]) -> Table:
    """When there are how many vehicles; the moments with most of them that move are marked."""
    from rich.table import Table
    from rich.text import Text

    about = "complete: vehicles that move and are\nrecorded from 1 s before to 3 s after;\n*: most of them"
    table = Table(title=about, title_justify="left")
    cases = any(moment.case for moment in moments)
    for head in (*(["case"] if cases else []), "time [s]", "vehicles", "complete", ""):
        table.add_column(Text(head), justify="right")
    most = max((moment.complete for moment in moments), default=0)
    for moment in moments:
        cells = [f"{moment.time_s:g}", str(moment.vehicles), str(moment.complete)]
        table.add_row(*([moment.case] if cases else []), *cells, "*" if moment.complete == most else "")
    return table


def _vehicles_table(scene: SeedScene) -> Table:
    """Who is where at a moment, and how fast."""
    from rich.table import Table
    from rich.text import Text

    from scex_sumo.scene import STEP_S

    table = Table(title=f"{scene.name}: {scene.vehicles} vehicles", title_justify="left")
    for head in ("track", "type", "x [m]", "y [m]", "speed [m/s]", "length [m]", "history [s]"):
        table.add_column(Text(head), justify="right")
    now = scene.now
    for v, track in enumerate(scene.track_ids):
        sizes = (now.x[v], now.y[v], now.speed[v], scene.length[v])
        history = f"{STEP_S * scene.recorded_steps[v]:.1f}"
        table.add_row(str(track), scene.types[v], *(f"{x:.1f}" for x in sizes), history)
    return table
