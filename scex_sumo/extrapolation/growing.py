"""Growing run: more and more futures until the bands are narrow, or an extra settles P(collision)."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

from scex_sumo.extrapolation.extras import Work, working
from scex_sumo.extrapolation.job import Job
from scex_sumo.results.parts import Parts
from scex_sumo.statistics.bands import Look, grow, look, remainder_of


def run_until_narrow(
    job: Job, run: Callable[[Job], None], work_of: Callable[..., Work]
) -> tuple[Job, dict[str, Any], dict[int, Any]]:
    """Run the futures of a job with ``until_band``.

    Args:
        run: runs all futures of a job that have not run yet.
        work_of: makes the work of the extras, from ``job`` and ``part``.

    Returns:
        The job with the futures that ran, the entry ``band`` of ``run.json``, and what extras settled, by
        their number.
    """
    settings, tried, settled = job.settings, False, dict[int, Any]()
    assert settings.until_band is not None and settings.count is not None
    band = settings.until_band

    def measure(count: int) -> Look:
        nonlocal tried, settled
        grown = job.of(count)
        run(grown)
        parts = Parts(job.folder)
        band_now = look(grown.intervals, *parts.values(count), settings.columns)
        if tried or band_now.width <= band or remainder_of(count) > band:
            return band_now
        work = work_of(job=grown, part=parts.read(0, count, plans=False))
        known = {number: extra.settle(work) for number, extra in enumerate(working(work.extras, settings))}
        tried, settled = True, {number: one for number, one in known.items() if one is not None}
        least = min((one.remainder for one in settled.values()), default=1.0)
        if least > band:
            settled = {}
            return band_now
        return dataclasses.replace(band_now, remainder=least)

    last = grow(measure, band=band, most=settings.count)
    return job.of(last.futures), {"asked": band, **dataclasses.asdict(last)}, settled
