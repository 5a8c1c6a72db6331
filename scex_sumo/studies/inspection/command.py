"""``scex-sumo inspect``: moments and vehicles of a recording."""

from __future__ import annotations

import shlex
from functools import partial
from typing import TYPE_CHECKING

from scex_sumo.base.errors import UsageError
from scex_sumo.commands.console import warn
from scex_sumo.commands.options import Case, MapPath, Origin, Time, Tracks
from scex_sumo.commands.shared import Answer

if TYPE_CHECKING:
    from rich.table import Table

    from scex_sumo.converters.datasets.moment import Moment
    from scex_sumo.scene import SeedScene

EVERY_S = 1.0
_ROWS = 10  # moments in the terminal
EXAMPLE = "scex_sumo/scenarios/data/roundabout.osm --time 4.5"


def inspect_command(
    map_path: MapPath, tracks: Tracks = None, case: Case = None, time: Time = None, origin: Origin = None
) -> Answer:
    """List recordings, moments of one, or vehicles of a moment."""
    from scex_sumo.base.blame import calling_twice
    from scex_sumo.commands.console import output_console
    from scex_sumo.converters.datasets.cases import choose_case
    from scex_sumo.converters.datasets.find import left_out, map_and_tracks, recordings_of_folder
    from scex_sumo.converters.datasets.moment import busiest
    from scex_sumo.converters.datasets.recordings import recording_of
    from scex_sumo.converters.lanelet.origin import parse_origin
    from scex_sumo.evaluation.recordings import load_recording, recording_moments, seed_at
    from scex_sumo.reports.console_table import console_table, print_line
    from scex_sumo.scene import STEP_S
    from scex_sumo.studies.inspection.answer import inspect_answer

    warn(left_out([map_path] if map_path.is_dir() else []))
    if map_path.is_dir() and (tracks, case, time, origin) == (None,) * 4:
        recordings = recordings_of_folder(map_path)
        if len(recordings) > 1:
            from scex_sumo.studies.inspection.answer import inspect_folder

            return partial(dict, inspect_folder(recordings))
    map_path, tracks = map_and_tracks(map_path, tracks)
    zero = parse_origin(origin) if origin is not None else None
    with calling_twice():
        loaded = load_recording(recording_of(map_path, tracks), zero, force=True)
    console = output_console(width=110)
    warn(loaded.notes)
    print(f"{loaded.recording.name}: {loaded.vehicles} vehicles in {loaded.seconds:.1f} s")
    for finding in loaded.findings:
        print_line(f"repaired: {finding}", console)
    if loaded.checks:
        heads = [(head, "text", "") for head in ("before repairs", "measured", "plausible", "")]
        rows = [[check.name, check.value, check.usual, check.verdict] for check in loaded.checks]
        console.print(console_table("plausibility of the recording", heads, rows))
    words = ["scex-sumo", "run", str(map_path), *(["--tracks", str(tracks)] if tracks else [])]
    words += ["--origin", origin] if origin is not None else []
    moments, all_moments = (recording_moments(loaded, every_s=step) for step in (EVERY_S, STEP_S))
    best = busiest(all_moments) if all_moments else None  # the moment that run takes
    full = max([best, *all_moments], key=lambda moment: moment.vehicles) if best is not None else None
    marked = {moment for moment in (best, full) if moment is not None}
    if marked - {*moments}:
        moments = sorted({*moments, *marked}, key=lambda moment: moment.time_s)
    if time is None and case is None:
        console.print(_moments_table(_shown(moments, marked), len(moments)))
        lines = {full: "most vehicles", best: "most vehicles" if best is full else "most complete vehicles"}
        for moment, name in lines.items():
            if moment is not None:
                chosen = ["--case", moment.case] if moment.case else ["--time", f"{moment.time_s:g}"]
                print(f"{name}: {shlex.join([*words, *chosen])}")
        return partial(inspect_answer, loaded, moments, None)
    of_case = case is not None and time is None  # its own moment
    if case is not None:
        case = loaded.table.cases[choose_case(loaded.table, case, time)]
    if time is None:
        time = next((moment.time_s for moment in moments if moment.case == case), None)
        if time is None:
            raise UsageError(f"--case {case}: nobody is there at 1 s; choose with --time, too")
    scene = seed_at(loaded, time, case=case)
    console.print(_vehicles_table(scene))
    chosen = [] if case is None else ["--case", case]
    chosen += [] if of_case else ["--time", f"{scene.time_s:g}"]
    print(f"run it: {shlex.join([*words, *chosen])}")
    return partial(inspect_answer, loaded, moments, scene)


def _shown(moments: list[Moment], marked: set[Moment]) -> list[Moment]:
    """Return `_ROWS` moments, evenly chosen, with those that are marked."""
    others = [moment for moment in moments if moment not in marked]
    count = min(_ROWS - len(marked), len(others))
    chosen = [others[k * (len(others) - 1) // max(count - 1, 1)] for k in range(count)]
    return [moment for moment in moments if moment in (*marked, *chosen)]


def _moments_table(moments: list[Moment], of: int) -> Table:
    """Return the number of vehicles by moment; moments with most complete vehicles are marked."""
    from scex_sumo.reports.console_table import console_table

    about = "complete: vehicles that move and are\nrecorded from 1 s before to 3 s after;\n*: most of them"
    about += f"\n{len(moments)} of {of} moments, --json has all" if len(moments) < of else ""
    heads = [(head, "text", "") for head in ("case", "time [s]", "vehicles", "complete", "")]
    most = max((moment.complete for moment in moments), default=0)
    rows = [
        [m.case, f"{m.time_s:g}", m.vehicles, m.complete, "*" if m.complete == most else ""] for m in moments
    ]
    first = 0 if any(moment.case for moment in moments) else 1  # a recording without cases names none
    return console_table(about, heads[first:], [row[first:] for row in rows])


def _vehicles_table(scene: SeedScene) -> Table:
    from scex_sumo.reports.console_table import console_table
    from scex_sumo.scene import STEP_S

    heads = [(head, "text", "") for head in ("track", "type")]
    heads += [(head, ".1f", "") for head in ("x [m]", "y [m]", "speed [m/s]", "length [m]", "history [s]")]
    now, history = scene.now, STEP_S * scene.recorded_steps
    columns = scene.track_ids, scene.types, now.x, now.y, now.speed, scene.length, history
    rows = list(zip(*columns, strict=True))
    return console_table(f"{scene.name}: {scene.vehicles} vehicles", heads, rows)
