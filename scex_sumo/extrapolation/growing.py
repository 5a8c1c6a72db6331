"""Growing run: more and more futures until the bands are narrow."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

from scex_sumo.extrapolation.job import Job
from scex_sumo.results.parts import Parts
from scex_sumo.statistics.bands import Look, grow, look


def run_until_narrow(job: Job, run: Callable[[Job], None]) -> tuple[Job, dict[str, Any]]:
    """Run the futures of a job with ``until_band``; return the job that ran, and ``band`` of ``run.json``.

    Args:
        run: runs all futures of a job that have not run yet.
    """
    settings = job.settings
    assert settings.until_band is not None and settings.count is not None

    def measure(count: int) -> Look:
        grown = job.of(count)
        run(grown)
        return look(grown.intervals, *Parts(job.folder).values(count), settings.columns)

    last = grow(measure, band=settings.until_band, most=settings.count)
    return job.of(last.futures), {"asked": settings.until_band, **dataclasses.asdict(last)}
