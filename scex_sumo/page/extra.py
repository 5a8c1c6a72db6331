"""Page of a run as an extra: ``report.html``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from scex_sumo.base.options import option
from scex_sumo.extrapolation.extras import Extra, Work
from scex_sumo.extrapolation.options import OUTPUT
from scex_sumo.extrapolation.settings import RunSettings

if TYPE_CHECKING:
    from scex_sumo.results.run import Run


@dataclass(frozen=True, kw_only=True)
class ReportPage(Extra):
    """``report.html`` in the result folder, written last."""

    order: ClassVar[int] = 100
    files: ClassVar[tuple[str, ...]] = ("report.html",)
    nested: ClassVar[bool] = False

    report: bool = option("Write report.html.", True, names=("--report/--no-report",), panel=OUTPUT)

    def is_on(self, settings: RunSettings) -> bool:
        """See `Extra`."""
        return self.report

    def finish(self, run: Run, work: Work) -> Mapping[str, Path]:
        """Write the page."""
        from scex_sumo.page.report.report import write_report

        with work.options.bar("page"):
            return {"report": write_report(run, work.job.scene)}
