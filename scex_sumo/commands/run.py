"""``scex-sumo run``: from a map and a moment to a result folder."""

from __future__ import annotations

import dataclasses
import shlex
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Option

from scex_sumo.base.errors import UsageError
from scex_sumo.commands.console import progress_bar, resumable, warn
from scex_sumo.commands.options import (
    Around,
    Cache,
    Case,
    Fcd,
    Force,
    InRegion,
    Like,
    MapPath,
    Metrics,
    Models,
    Origin,
    Overwrite,
    Processes,
    ResultPath,
    RunPreset,
    Seed,
    Speed,
    State,
    Synthetic,
    Thresholds,
    Time,
    Tracks,
    parse_thresholds,
)
from scex_sumo.commands.seed import one_source, seed_scene
from scex_sumo.commands.shared import COMMANDS, Answer

if TYPE_CHECKING:
    from scex_sumo.results.run import Run


NO_REFERENCE = "none"


EXAMPLE = "k733.osm --tracks vehicle_tracks_000.csv --time 60 -o out/k733"


def run_command(
    map_path: MapPath,
    tracks: Tracks = None,
    fcd: Fcd = None,
    state: State = None,
    case: Case = None,
    time: Time = None,
    synthetic: Synthetic = None,
    like: Like = None,
    speed: Speed = None,
    origin: Origin = None,
    children: Annotated[
        str | None,
        Option(metavar="N|all", help="Number of futures: 385; at most 10000 with --until-band."),
    ] = None,
    steps: Annotated[int, Option(help="Steps of 0.1 s per future.")] = 30,
    replan: Annotated[int, Option(help="Steps between two plans.")] = 5,
    models: Models = None,
    assign: Annotated[
        list[str] | None, Option(metavar="TRACK=MODEL", help="A vehicle's model; repeatable.")
    ] = None,
    under_test: Annotated[
        list[str] | None,
        Option(metavar="TRACK=MODEL", help="A driving function under test, measured apart; repeatable."),
    ] = None,
    baseline: Annotated[bool, Option(help="Run the futures without the models under test, too.")] = True,
    reference: Annotated[
        str, Option(metavar="MIX|none", help="Human-like reference, run after the stress test.")
    ] = "likely",
    design: Annotated[
        str | None, Option(metavar="NAME", help="How assignments are drawn: balanced (default) or random.")
    ] = None,
    until_band: Annotated[
        float | None,
        Option(metavar="W", help="Go on until all 95 % bands, or an exact P, are within +-W."),
    ] = None,
    region: InRegion = None,
    around: Around = None,
    preset: RunPreset = None,
    metrics: Metrics = None,
    threshold: Thresholds = None,
    reflect: Annotated[bool, Option(help="Separate shared values and reflect densities at 0.")] = True,
    seed: Seed = 0,
    workers: Processes = 1,
    batch: Annotated[int | None, Option(help="Futures in one SUMO process; default: automatic.")] = None,
    gui: Annotated[
        bool, Option("--gui", help="Show the run live in sumo-gui, then its worst future.")
    ] = False,
    plots: Annotated[
        bool, Option("--report/--no-report", "--plots/--no-plots", help="Write report.html.")
    ] = True,
    world: Annotated[
        str,
        Option(
            metavar="sumo|plain|checked|NAME",
            help="plain: without SUMO; checked: plain, compared with SUMO; or an entry point.",
        ),
    ] = "sumo",
    cache: Cache = True,
    exact: Annotated[bool, Option(help="Run some more futures for exact probabilities.")] = True,
    keep_plans: Annotated[bool, Option(help="Write plans.parquet, to evaluate gap times again.")] = False,
    force: Force = False,
    overwrite: Overwrite = False,
    out: ResultPath = None,
) -> Answer:
    """Simulate futures of one moment of traffic, and measure how critical they become."""
    from scex_sumo.behaviors.registry import parse_models
    from scex_sumo.commands.answers import run_answer
    from scex_sumo.extrapolation.engine import (
        RunOptions,
        add_reference,
        check_world,
        drop_reference,
        run_scene,
    )
    from scex_sumo.extrapolation.models import ModelSet
    from scex_sumo.extrapolation.settings import RunSettings
    from scex_sumo.extrapolation.workers import Workers
    from scex_sumo.results.region import parse_region
    from scex_sumo.statistics.bands import MAX_CHILDREN
    from scex_sumo.world.base import DEFAULT_WORLD

    if until_band is not None and children is None:
        children = str(MAX_CHILDREN)
    given = {"models": models, "children": children, "design": design, "preset": preset}
    settings = RunSettings(
        **{name: value for name, value in given.items() if value is not None},
        assign=parse_assign(assign or ()),
        under_test=parse_under_test(under_test or ()),
        baseline=baseline,
        until_band=until_band,
        steps=steps,
        replan=replan,
        seed=seed,
        world=world,
        metrics=None if metrics is None else [name.strip() for name in metrics.split(",")],
        thresholds=parse_thresholds(threshold),
        reflect=reflect,
        keep_plans=keep_plans,
        region=parse_region(region, around),
    )
    if reference != NO_REFERENCE:
        parse_models(reference)  # an error now, not after the run
    if out is not None and out.is_file():
        raise UsageError(f"-o {out}: is a file; name a folder")
    options = RunOptions(batch=batch, gui=gui, cache=cache, exact=exact)
    if gui or world != DEFAULT_WORLD:
        check_world(settings, ModelSet.of(settings), gui=gui)
    command = ["scex-sumo", *sys.argv[1:]]
    page = None
    with Workers(1 if gui else min(workers, settings.count or workers)) as pool:  # start while we read
        scene = seed_scene(
            map_path,
            tracks=one_source(tracks, fcd, state),
            case=case,
            time=time,
            synthetic=synthetic,
            like=like,
            speed=speed,
            origin=origin,
            seed=seed,
            cache=cache,
            force=force,
        )
        folder = out if out is not None else Path("out") / scene.name
        with progress_bar(scene.name) as tick, resumable("futures", folder):
            result = run_scene(
                scene,
                settings,
                out=folder,
                workers=pool,
                overwrite=overwrite,
                options=dataclasses.replace(options, progress=tick, command=command),
            )
        if reference == NO_REFERENCE:
            drop_reference(result)
        else:
            with progress_bar("reference") as tick, resumable("futures", folder):
                options = RunOptions(cache=cache, exact=exact, progress=tick, command=command)
                add_reference(result, scene, reference, settings, workers=pool, options=options)
        _tell(result, preset)
        print(f"result: {folder}")
        if plots:
            from scex_sumo.page.report import write_report

            page = write_report(result, scene)
            print(f"report: {page}")
    shown, option = _worst_option(result)
    options_of_view = " ".join(f"--{name} {value}" for name, value in option.items())
    print(f"look:   scex-sumo view {shlex.quote(str(shown))} {options_of_view}")
    if gui:
        COMMANDS.load("view")(shown, **option)
    return partial(run_answer, result, page)


def _tell(run: Run, preset: str | None) -> None:
    from scex_sumo.commands.console import output_console
    from scex_sumo.reports.run_table import print_summary

    warn([*run.info["net_notes"], *run.info["run_notes"]])
    if run.baseline is not None:
        from scex_sumo.studies.under_test.table import print_under_test

        print_under_test(run, output_console(width=110), preset=preset)
    print_summary(run, output_console(width=110), preset=preset)
    if run.info["band"] is not None:
        _print_band(run.info["band"])


def _worst_option(run: Run) -> tuple[Path, dict[str, Any]]:
    """Return folder and option of ``view``: the worst encounter, else the most critical, else any child."""
    from scex_sumo.reports.encounter_rows import meetings, worst_of

    if worst := worst_of(meetings(run), 1):
        row = worst[0].row
        return worst[0].run.folder, {"encounter": f"{row['track_id']},{row['other_id']}"}
    defined = [name for name in ("ttc", "wttc") if name in run.columns and len(run.samples(name))]
    return run.folder, {"critical": defined[0]} if defined else {"child": 0}


def _print_band(band: dict[str, Any]) -> None:
    left_out = f"; defined too rarely to count: {', '.join(band['left_out'])}" if band["left_out"] else ""
    exact = band.get("remainder") is not None
    if exact:
        print(
            f"P(collision) is exact after {band['children']} futures, remainder {band['remainder']:.3f}; "
            "--no-exact goes on until the bands are narrow"
        )
    short = "" if exact or band["width"] <= band["asked"] else f", not the +-{band['asked']:g} asked for"
    print(
        f"widest 95 % band: +-{band['width']:.3f} ({band['metric'] or 'no metric'}) "
        f"after {band['children']} futures{short}{left_out}"
    )


def parse_assign(entries: Sequence[str], option: str = "--assign") -> dict[int, str]:
    """Parse ``TRACK=MODEL`` entries of an option, each vehicle once."""
    result: dict[int, str] = {}
    for entry in entries:
        track, equals, model = entry.partition("=")
        if not equals or not model or not track.strip().lstrip("-").isdigit():
            raise UsageError(f"{option} {entry}: needs TRACK=MODEL, e.g. {option} 17=emergency_brake")
        if int(track) in result:
            raise UsageError(f"{option} {entry}: vehicle {int(track)} is given twice; give it one model")
        result[int(track)] = model
    return result


def parse_under_test(entries: Sequence[str]) -> dict[int, str | None]:
    """Parse ``TRACK=MODEL`` entries, or ``TRACK`` alone for a vehicle that is driven as drawn."""
    alone = [entry for entry in entries if entry.strip().isdigit()]
    models = parse_assign([entry for entry in entries if entry not in alone], "--under-test")
    for entry in alone:
        if int(entry) in models:
            raise UsageError(f"--under-test {entry}: vehicle {int(entry)} is given twice; give it once")
    return {**models, **{int(entry): None for entry in alone}}
