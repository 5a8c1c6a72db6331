"""Workers of a run: this process alone, or with a pool of further ones."""

from __future__ import annotations

import resource
from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from scex_sumo.base.errors import SimulationError, UsageError

if TYPE_CHECKING:
    from typing_extensions import Self

    from scex_sumo.base.arrays import IntArray
    from scex_sumo.extrapolation.job import Job
    from scex_sumo.extrapolation.processes.pool import Pool

MAX_PROCESSES = 1000
MIN_ADDRESS_SPACE = 3 * 10**9  # bytes; with less, libsumo or Arrow crash while they are loaded


class Workers:
    """Processes that run futures; a context manager. They start at once.

    Attributes:
        pool: all but one of the processes; this process is the other. None if it is alone.
    """

    def __init__(self, processes: int) -> None:
        if not 1 <= processes <= MAX_PROCESSES:
            raise UsageError(f"--workers: got {processes}, needs 1 to {MAX_PROCESSES}")
        limit, _ = resource.getrlimit(resource.RLIMIT_AS)
        if limit != resource.RLIM_INFINITY and limit < MIN_ADDRESS_SPACE:
            raise SimulationError(
                f"ulimit -v leaves each process {limit / 1e9:.1f} GB of address space, libsumo with Arrow "
                f"needs {MIN_ADDRESS_SPACE / 1e9:.1f} GB; raise it, or limit resident memory instead"
            )
        self.processes = processes
        self.pool: Pool | None = None
        if processes > 1:
            from scex_sumo.extrapolation.processes.pool import Pool

            self.pool = Pool(processes - 1, simulates=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self.pool is not None:
            self.pool.close()

    @property
    def deaths(self) -> list[str]:
        """One phrase for each worker that died and was replaced."""
        return [] if self.pool is None else self.pool.deaths

    def run(
        self, job: Job, batches: Sequence[IntArray], *, together: int, on_step: Callable[[int], None]
    ) -> None:
        """Run batches of futures, here and in the pool, and save their parts in the result folder.

        Args:
            together: batches that a process may run as one.
            on_step: called with a number of futures when they have made a step.

        Raises:
            SimulationError: two workers died over the same batch.
            Exception: whatever a batch raises.
        """
        from scex_sumo.extrapolation.job import batch_runner

        futures = np.concatenate(batches)
        if self.pool is not None:
            self.pool.run(partial(batch_runner, job, futures), batches, on_step, together=together)
            return
        with batch_runner(job, futures) as run_here:
            for batch in batches:
                run_here(batch, on_step)
