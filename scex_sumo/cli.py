"""The command line: reads options, calls the library, prints. No logic."""

from __future__ import annotations

import io
import signal
import sys
from pathlib import Path
from typing import Annotated

import typer

from scex_sumo.errors import ScexError, UsageError

app = typer.Typer(
    name="scex-sumo",
    help="Hundreds of futures of one moment of traffic, and how critical it can become.",
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)

MapPath = Annotated[Path, typer.Argument(metavar="MAP.osm", help="Lanelet2 map (CommonRoad: .xml).")]
Origin = Annotated[
    str | None,
    typer.Option(metavar="LAT,LON", help="Origin of the map's coordinates; else from meta_data.csv."),
]
Tracks = Annotated[
    Path | None, typer.Option(metavar="CSV", help="Recorded tracks; else looked for beside the map.")
]
Case = Annotated[str | None, typer.Option(metavar="ID", help="Case of a file with case_id.")]
Moment = Annotated[float | None, typer.Option(metavar="S", help="Moment in seconds of the recording.")]
Synthetic = Annotated[
    int | None, typer.Option(metavar="N", help="Populate the map with N vehicles by SUMO instead.")
]
Seed = Annotated[int, typer.Option(help="Random seed.")]
Workers = Annotated[int, typer.Option(help="Processes.")]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace another run's result.")]
ResultPath = Annotated[Path | None, typer.Option("-o", "--out", metavar="OUT", help="Result folder.")]


def _version(wanted: bool) -> None:
    if wanted:
        from scex_sumo.version import __version__

        print(f"scex-sumo {__version__}")
        raise typer.Exit


@app.callback()
def _root(
    version: Annotated[bool, typer.Option("--version", callback=_version, is_eager=True)] = False,
) -> None:
    pass


@app.command(
    epilog="Example: scex-sumo run k733.osm --tracks vehicle_tracks_000.csv --time 60 -o out/k733",
)
def run(
    map_path: MapPath,
    tracks: Tracks = None,
    case: Case = None,
    time: Moment = None,
    synthetic: Synthetic = None,
    origin: Origin = None,
    children: Annotated[
        str | None,
        typer.Option(
            metavar="N|all", help="Number of child scenarios: 385; at most 10000 with --until-band."
        ),
    ] = None,
    steps: Annotated[int, typer.Option(help="Steps of 0.1 s per child.")] = 30,
    replan: Annotated[int, typer.Option(help="Steps that a plan is followed.")] = 5,
    models: Annotated[
        str | None,
        typer.Option(metavar="MODEL[@WEIGHT],...", help="Models to draw from; see 'scex-sumo models'."),
    ] = None,
    assign: Annotated[
        list[str] | None, typer.Option(metavar="TRACK=MODEL", help="A vehicle's model; repeatable.")
    ] = None,
    under_test: Annotated[
        list[str] | None,
        typer.Option(metavar="TRACK=MODEL", help="A driving function under test, told apart; repeatable."),
    ] = None,
    baseline: Annotated[
        bool, typer.Option(help="Run the children without the models under test, too.")
    ] = True,
    design: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="How assignments are drawn: balanced (default), random, ..."),
    ] = None,
    until_band: Annotated[
        float | None,
        typer.Option(metavar="W", help="Go on until all 95 % bands are within +-W, e.g. 0.05."),
    ] = None,
    threshold: Annotated[
        list[str] | None,
        typer.Option(metavar="METRIC=VALUE", help="Where a metric becomes critical; repeatable."),
    ] = None,
    seed: Seed = 0,
    workers: Workers = 1,
    batch: Annotated[int | None, typer.Option(help="Children side by side in one SUMO; else chosen.")] = None,
    gui: Annotated[bool, typer.Option("--gui", help="Show the run live in sumo-gui.")] = False,
    plots: Annotated[bool, typer.Option(help="Draw the densities.")] = True,
    keep_plans: Annotated[
        bool, typer.Option(help="Write plans.parquet, to evaluate gap times again.")
    ] = True,
    overwrite: Overwrite = False,
    out: ResultPath = None,
) -> None:
    """Let one moment of traffic run on many times, and measure every child scenario."""
    from scex_sumo.commands.run import RunRequest, run_command

    run_command(
        RunRequest(
            map_path=map_path,
            tracks=tracks,
            case=case,
            time_s=time,
            synthetic=synthetic,
            origin=origin,
            children=children,
            steps=steps,
            replan=replan,
            models=models,
            assign=tuple(assign or ()),
            under_test=tuple(under_test or ()),
            baseline=baseline,
            thresholds=tuple(threshold or ()),
            design=design,
            until_band=until_band,
            seed=seed,
            workers=workers,
            batch=batch,
            gui=gui,
            plots=plots,
            keep_plans=keep_plans,
            overwrite=overwrite,
            out=out,
        )
    )


@app.command(epilog="Example: scex-sumo convert DR_DEU_Roundabout_OF.osm -o roundabout.net.xml")
def convert(
    map_path: Annotated[
        Path | None, typer.Argument(metavar="MAP.osm", help="Lanelet2 map (CommonRoad: .xml).")
    ] = None,
    out: Annotated[
        Path | None, typer.Option("-o", "--out", metavar="NET.net.xml", help="SUMO net to write.")
    ] = None,
    origin: Origin = None,
    signals: Annotated[
        Path | None,
        typer.Option(metavar="CSV", help="Recorded signal phases (SPaT csv; its kml beside it)."),
    ] = None,
    check: Annotated[
        Path | None, typer.Option(metavar="NET", help="Judge this net against --map instead of converting.")
    ] = None,
    check_map: Annotated[
        Path | None, typer.Option("--map", metavar="MAP.osm", help="Map that --check compares with.")
    ] = None,
    drive: Annotated[
        bool, typer.Option("--drive", help="With --check: let 120 of SUMO's cars drive all routes, too.")
    ] = False,
    json_report: Annotated[
        bool, typer.Option("--json-report", help="Print the fidelity figures as JSON.")
    ] = False,
) -> None:
    """Convert a Lanelet2 or CommonRoad map to a SUMO net, or judge a net against its map."""
    from scex_sumo.commands.convert import check_command, convert_command

    if check is not None:
        source = check_map or map_path
        if source is None:
            raise UsageError("--check: needs the map too, with --map MAP.osm")
        check_command(check, source, origin=origin, drive=drive, as_json=json_report)
    elif drive:
        raise UsageError("--drive: needs a net to drive on, with --check NET --map MAP")
    elif map_path is None:
        raise UsageError("convert: needs MAP.osm, or --check NET --map MAP.osm")
    else:
        convert_command(map_path, out, origin=origin, signals=signals, as_json=json_report)


@app.command(epilog="Example: scex-sumo view out/k733 --critical wttc")
def view(
    folder: Annotated[Path, typer.Argument(metavar="OUT", help="Result folder.")],
    child: Annotated[int | None, typer.Option(metavar="N", help="Show this child.")] = None,
    grid: Annotated[int | None, typer.Option(metavar="N", help="Show N children side by side.")] = None,
    critical: Annotated[
        str | None, typer.Option(metavar="METRIC", help="Show the child most critical by this metric.")
    ] = None,
    write_only: Annotated[
        bool, typer.Option("--write-only", help="Write the files, print the path, open nothing.")
    ] = False,
) -> None:
    """Open child scenarios in sumo-gui."""
    from scex_sumo.commands.view import view_command

    view_command(folder, child=child, grid=grid, critical=critical, write_only=write_only)


@app.command(epilog="Example: scex-sumo export out/k733 --child 7 --to fcd -o child7.fcd.xml")
def export(
    folder: Annotated[Path, typer.Argument(metavar="OUT", help="Result folder.")],
    child: Annotated[int, typer.Option(metavar="N", help="The child scenario.")],
    to: Annotated[str, typer.Option(metavar="interaction|fcd", help="Format.")] = "interaction",
    out: Annotated[Path | None, typer.Option("-o", "--out", metavar="FILE", help="File to write.")] = None,
) -> None:
    """Write one child scenario in another tool's format."""
    from scex_sumo.commands.view import export_command

    export_command(folder, child=child, to=to, out=out)


@app.command(epilog="Example: scex-sumo metrics vehicle_tracks_000.csv --level scene -o scenes.parquet")
def metrics(
    source: Annotated[
        Path, typer.Argument(metavar="TRACKS|OUT", help="Tracks in INTERACTION format, or a result folder.")
    ],
    map_path: Annotated[
        Path | None, typer.Option("--map", metavar="MAP.osm", help="Accepted; no metric needs it so far.")
    ] = None,
    level: Annotated[str, typer.Option(metavar="pair|scene|scenario|worst", help="Rows.")] = "scenario",
    preset: Annotated[str, typer.Option(metavar="paper|path", help="Who follows whom.")] = "paper",
    only: Annotated[
        str | None, typer.Option("--metrics", metavar="NAME,...", help="These only; else the paper's six.")
    ] = None,
    wttc_limits: Annotated[
        str | None, typer.Option(metavar="TYPE=M/S2,...", help="Largest accelerations by type, for WTTC.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option("-o", "--out", metavar="FILE", help="FILE.parquet or .csv; else CSV here.")
    ] = None,
) -> None:
    """Evaluate criticality metrics of recorded or simulated tracks."""
    from scex_sumo.commands.metrics import metrics_command

    metrics_command(
        source,
        map_path=map_path,
        level=level,
        preset=preset,
        metrics=only,
        by_type=wttc_limits,
        out=out,
    )


@app.command("sample-size", epilog="Example: scex-sumo sample-size roundabout.osm -o out/enough")
def sample_size(
    map_path: MapPath,
    tracks: Tracks = None,
    case: Case = None,
    time: Moment = None,
    synthetic: Synthetic = None,
    origin: Origin = None,
    vehicles: Annotated[int, typer.Option(help="How many take part, those nearest to each other.")] = 5,
    models: Annotated[
        str | None, typer.Option(metavar="MODEL,...", help="Models; else six as in the paper's study.")
    ] = None,
    sizes: Annotated[str, typer.Option(metavar="N,...", help="Sizes of the samples.")] = "1000,385,100,10",
    draws: Annotated[int, typer.Option(help="Samples of each size.")] = 200,
    designs: Annotated[
        str, typer.Option(metavar="NAME,...", help="random: subsets; others as --design of run.")
    ] = "random",
    seed: Seed = 0,
    workers: Workers = 1,
    plots: Annotated[bool, typer.Option(help="Draw the densities and errors.")] = True,
    overwrite: Overwrite = False,
    out: ResultPath = None,
) -> None:
    """Run every assignment of a small seed scene, and see how few of them would have been enough."""
    from scex_sumo.commands.sample_size import StudyRequest, sample_size_command

    sample_size_command(
        StudyRequest(
            map_path=map_path,
            tracks=tracks,
            case=case,
            time_s=time,
            synthetic=synthetic,
            origin=origin,
            vehicles=vehicles,
            models=models,
            sizes=sizes,
            draws=draws,
            designs=designs,
            seed=seed,
            workers=workers,
            plots=plots,
            overwrite=overwrite,
            out=out,
        )
    )


@app.command(epilog="Example: scex-sumo rank recordings/ --every 1 --workers 8 -o out/ranking")
def rank(
    roots: Annotated[
        list[Path],
        typer.Argument(metavar="DATASET...", help="Folders of recordings.", show_default=False),
    ],
    every: Annotated[float, typer.Option(metavar="S", help="Least time between two seed scenes.")] = 1.0,
    children: Annotated[int, typer.Option(help="Children of a seed scene at most.")] = 96,
    first: Annotated[
        int, typer.Option(help="Children of every seed scene; more where ranks are close.")
    ] = 32,
    min_vehicles: Annotated[int, typer.Option(help="Fewer moving vehicles make no seed scene.")] = 2,
    models: Annotated[
        str | None,
        typer.Option(metavar="MODEL[@WEIGHT],...", help="Models to draw from; see 'scex-sumo models'."),
    ] = None,
    threshold: Annotated[
        list[str] | None,
        typer.Option(metavar="METRIC=VALUE", help="Where a metric becomes critical; repeatable."),
    ] = None,
    keep: Annotated[
        str, typer.Option(metavar="none|critical|all", help="Children whose tracks are kept.")
    ] = "none",
    top: Annotated[int, typer.Option(help="Moments on the page.")] = 10,
    seed: Seed = 0,
    workers: Workers = 1,
    cluster: Annotated[
        str | None, typer.Option(metavar="tcp://HOST:PORT", help="Dask scheduler, for its workers instead.")
    ] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace another ranking.")] = False,
    out: Annotated[
        Path | None, typer.Option("-o", "--out", metavar="OUT", help="Folder; else out/ranking.")
    ] = None,
) -> None:
    """Run all moments of a dataset, and rank them: which are worth testing."""
    from scex_sumo.commands.rank import RankRequest, rank_command

    rank_command(
        RankRequest(
            roots=tuple(roots),
            every=every,
            children=children,
            first=first,
            min_vehicles=min_vehicles,
            models=models,
            thresholds=tuple(threshold or ()),
            keep=keep,
            top=top,
            seed=seed,
            workers=workers,
            cluster=cluster,
            overwrite=overwrite,
            out=out,
        )
    )


@app.command(epilog="Example: scex-sumo compare out/k733 out/k729 out/merge -o out/compared")
def compare(
    folders: Annotated[
        list[Path], typer.Argument(metavar="OUT...", help="Result folders, at least two.", show_default=False)
    ],
    nearest: Annotated[
        Path | None, typer.Option(metavar="OUT", help="List the others by their distance to this one.")
    ] = None,
    distance: Annotated[str, typer.Option(metavar="w1|jsd", help="What is measured.")] = "w1",
    groups: Annotated[
        int | None, typer.Option(metavar="N", help="Number of groups; else where they are clearest.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option("-o", "--out", metavar="FOLDER", help="Write tables and pictures here.")
    ] = None,
) -> None:
    """Compare seed scenes by the densities of their metrics: distances, groups, nearest neighbours."""
    from scex_sumo.commands.compare import compare_command

    compare_command(folders, nearest=nearest, distance=distance, groups=groups, out=out)


@app.command(epilog="Example: scex-sumo explain out/k733 --metric ttc")
def explain(
    folder: Annotated[Path, typer.Argument(metavar="OUT", help="Result folder.")],
    metric: Annotated[
        str | None, typer.Option(metavar="METRIC", help="Print this one, with all its worst children.")
    ] = None,
    worst: Annotated[int, typer.Option(metavar="N", help="How many of the worst children are named.")] = 5,
    plots: Annotated[bool, typer.Option(help="Draw the shares.")] = True,
) -> None:
    """Say which vehicles' drivers make a scene critical, and how."""
    from scex_sumo.commands.explain import explain_command

    explain_command(folder, metric=metric, worst=worst, plots=plots)


@app.command(epilog="Example: scex-sumo train graph --data ../shared/data/mona --data taf_bw --out mine.pt")
def train(
    kind: Annotated[str, typer.Argument(metavar="graph|hybrid", help="Network.", show_default=False)],
    data: Annotated[
        list[Path] | None, typer.Option(metavar="ROOT", help="Folder with recordings; repeatable.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option("-o", "--out", metavar="WEIGHTS", help="File of weights to write.")
    ] = None,
    seed: Seed = 0,
    epochs: Annotated[int | None, typer.Option(help="Passes over all samples; else as shipped.")] = None,
    rounds: Annotated[int | None, typer.Option(help="Rounds in closed loop; else as shipped.")] = None,
    minutes: Annotated[float, typer.Option(help="Stop after so many minutes; 0 does not.")] = 0.0,
    every: Annotated[float, typer.Option(metavar="S", help="Seconds between two scenes.")] = 0.5,
    leave_out: Annotated[
        list[str] | None, typer.Option(metavar="SITE", help="Do not train on this site; repeatable.")
    ] = None,
    edges: Annotated[bool, typer.Option(help="Vehicles see each other through the graph.")] = True,
    device: Annotated[str, typer.Option(metavar="auto|cpu|cuda", help="Where to train.")] = "auto",
    resume: Annotated[bool, typer.Option("--resume", help="Go on from the checkpoint beside --out.")] = False,
    cache: Annotated[
        Path | None, typer.Option(metavar="FOLDER", help="Samples are kept here; else ~/.cache/scex-sumo.")
    ] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace the weights.")] = False,
) -> None:
    """Train a learned driver on recordings: INTERACTION, TAF-BW, CommonRoad, inD and its family."""
    from scex_sumo.commands.train import TrainRequest, train_command

    train_command(
        TrainRequest(
            kind=kind,
            roots=tuple(data or ()),
            out=out,
            seed=seed,
            epochs=epochs,
            rounds=rounds,
            minutes=minutes,
            device=device,
            resume=resume,
            every_s=every,
            leave_out=tuple(leave_out or ()),
            edges=edges,
            cache=cache,
            overwrite=overwrite,
        )
    )


@app.command(epilog="Example: scex-sumo models")
def models() -> None:
    """List the behaviour models and their parameters."""
    from scex_sumo.commands.models import models_command

    models_command()


def main() -> None:
    """Entry point: errors become one line and an exit status."""
    # A scheduler's SIGTERM leaves what Ctrl-C leaves: finished children, and no worker behind.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal without – gets ? for it
    try:
        status = app(sys.argv[1:] or ["--help"], standalone_mode=False)
    except ScexError as error:
        _fail(f"error: {error}", 2 if isinstance(error, UsageError) else 1)
    except typer.Abort:
        _fail("interrupted", 130)
    except KeyboardInterrupt:
        _fail("interrupted", 130)
    except BrokenPipeError:
        sys.stderr.close()
        raise SystemExit(1) from None
    except OSError as error:  # of the machine, not of the program: a full disk, a file taken away
        _fail(f"error: {error.filename or 'a file'}: {error.strerror or error}; see to it and try again", 1)
    except Exception as error:
        shown = getattr(error, "format_message", None)
        if shown is None:
            raise
        _fail(f"error: {shown()}", 2)
    if status:  # Typer turns Ctrl-C into a status
        _fail("interrupted", int(status))


def _fail(message: str, status: int) -> None:
    print(message, file=sys.stderr)
    raise SystemExit(status)
