"""``scex-sumo watch``: risk of a SUMO simulation while it runs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument, Option

from scex_sumo.base.errors import UsageError
from scex_sumo.base.outputs import check_output, remember
from scex_sumo.commands.console import output_console, warn
from scex_sumo.commands.options import OutFolder
from scex_sumo.commands.shared import Answer

if TYPE_CHECKING:
    from scex_sumo.live.risk import Risk
    from scex_sumo.live.watch import Watch

EXAMPLE = "out/simulation/future.sumocfg --every 0.5 -o out/watch"
_SAVE_EVERY = 100  # moments
_MAX_BRAKING_MPS2 = 20.0


def watch_command(
    scenario: Annotated[
        Path, Argument(metavar="MINE.sumocfg", help="SUMO configuration.", show_default=False)
    ],
    gui: Annotated[bool, Option("--gui", help="Show it in sumo-gui, in real time.")] = False,
    every: Annotated[float, Option(metavar="S", help="Time between two moments, s.")] = 1.0,
    region: Annotated[
        str | None,
        Option(
            metavar="X,Y,R|ID",
            help="Only pairs with a vehicle in this circle, or within 30 m of this vehicle, m; default: the "
            "25 vehicles in the busiest place.",
        ),
    ] = None,
    follow: Annotated[
        bool,
        Option(
            "--follow",
            help="Of --gui: the view follows the pair that leads, and shows a typical critical future of it.",
        ),
    ] = False,
    first_s: Annotated[float | None, Option("--from", metavar="S", help="First moment, s.")] = None,
    last_s: Annotated[float | None, Option("--to", metavar="S", help="End, s.")] = None,
    futures: Annotated[int, Option(help="Futures of the stress test of each moment; 0: none.")] = 64,
    models: Annotated[str | None, Option(metavar="MIX", help="Models of the stress test.")] = None,
    workers: Annotated[int, Option(help="Processes.")] = 2,
    out: OutFolder = Path("out") / "watch",
) -> Answer:
    """Watch a SUMO simulation: what could happen next, while it runs."""
    from scex_sumo.live.folder import PAGE, RISK
    from scex_sumo.live.moment import Focus
    from scex_sumo.live.risk import Question
    from scex_sumo.live.session import Session

    if follow and not gui:
        raise UsageError("--follow: needs --gui")
    Focus(region=region)
    question: dict[str, Any] = {"futures": futures, **({"models": models} if models else {})}
    Question(**question)
    session = Session(config=scenario, out=out, gui=gui, begin_s=first_s, end_s=last_s, follow=follow)
    reporter = _Reporter(out)
    files = [out / name for name in (RISK, PAGE)]
    for file in files:
        check_output(file, scenario)

    def begin(watch: Watch, take: Any) -> None:
        reporter.watch = watch
        watch.every(every, take, region=region, wait=not gui, workers=workers, **question)

    early = session.run(begin, reporter)
    page = reporter.write(scenario)
    remember(*files)
    warn([f"{early}; what was watched until then is kept"] if early else [])
    print(f"result: {out / 'risk.parquet'}")
    print(f"look:   {page}")
    return lambda: reporter.answer(page)


class _Reporter:
    """Prints each risk in one line, and keeps it."""

    def __init__(self, out: Path) -> None:
        self.risks: list[Risk] = []
        self.watch: Watch | None = None
        self._out, self._console = out, output_console(width=200)
        self._skipped = 0

    def __call__(self, risk: Risk) -> None:
        from scex_sumo.live.folder import write_risks
        from scex_sumo.reports.console_table import print_line

        self.risks.append(risk)
        print_line(self._line(risk), self._console)
        if len(self.risks) % _SAVE_EVERY == 0:
            write_risks(self._out, self.risks)

    def _line(self, risk: Risk) -> str:
        assert self.watch is not None
        missed, self._skipped = self.watch.skipped - self._skipped, self.watch.skipped
        behind = f"; behind: {missed} moment{'s' if missed > 1 else ''} skipped" if missed else ""
        count = f"{len(risk.vehicles):3} vehicle{'s' if len(risk.vehicles) != 1 else ' '}"
        return f"{risk.time_s:8.1f} s  {count}  {_words(risk)}{behind}"

    def write(self, config: Path) -> Path:
        """Write tables and page, and return the page's path."""
        from scex_sumo.live.folder import write_page, write_risks

        write_risks(self._out, self.risks)
        skipped = 0 if self.watch is None else self.watch.skipped
        about = f"{len(self.risks)} moments assessed, {skipped} skipped"
        return write_page(self._out, config, self.risks, about)

    def answer(self, page: Path) -> dict[str, Any]:
        """Return the answer in JSON."""
        from scex_sumo.live.folder import worst_moments

        return {
            "result": self._out / "risk.parquet",
            "report": page,
            "moments": len(self.risks),
            "skipped": 0 if self.watch is None else self.watch.skipped,
            "worst": [
                {
                    "time_s": risk.time_s,
                    "pair": list(pair.names),
                    "human_like": pair.human_like,
                    "stress": pair.stress,
                    "how": pair.how,
                }
                for risk, pair in worst_moments(self.risks)
            ],
        }


def _words(risk: Risk) -> str:
    from scex_sumo.results.tables.pairs import once_in

    pair = risk.worst
    if pair is None:
        return "no pair collides"
    frequency = once_in(pair.human_like) if pair.human_like else "hardly ever"
    stress = "" if pair.stress is None else f", stress {pair.stress:.0%}"
    braking, needs = pair.needed_braking, ""
    if braking is not None:
        needs = f", needs {braking:.1f} m/s²" if braking < _MAX_BRAKING_MPS2 else ", braking is too late"
    kind = f" ({pair.kind})" if pair.kind else ""
    return f"{pair.hits} → {pair.other}{kind}: {frequency}{stress}{needs}"
