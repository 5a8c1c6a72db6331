"""Critical responses as an extra of a run: ``response.parquet``, sentences, P of a collision of people."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping, Sequence
from concurrent.futures import Future
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from scex_sumo.base.errors import ResultError, listed
from scex_sumo.certainty.options import DECISION, MAPS, PEOPLE, RESPONSE, CriticalResponse
from scex_sumo.extrapolation.extras import Work
from scex_sumo.extrapolation.job import Job
from scex_sumo.extrapolation.models import ModelSet
from scex_sumo.extrapolation.options import RunOptions
from scex_sumo.extrapolation.processes.pool import succeeded
from scex_sumo.extrapolation.processes.workers import Workers
from scex_sumo.extrapolation.settings import RunSettings
from scex_sumo.results.extras import Decision, Row
from scex_sumo.results.participants import people_apart
from scex_sumo.results.run import Run
from scex_sumo.scene import SeedScene

if TYPE_CHECKING:
    from scex_sumo.certainty.response.decision import PairResponse
    from scex_sumo.certainty.response.usual import Population

HEAD: Final = "human-like, by actions and response times"
_ROW: Final = "people collide"
_WORST = 3  # lines of pairs


class ResponseExtra(CriticalResponse):
    """Critical responses with their methods."""

    def check(self, settings: RunSettings, models: ModelSet) -> None:
        """Raise a `UsageError` for a bad file."""
        self._population()
        if self._file is not None:
            from scex_sumo.certainty.response.people import people_of

            people_of(self._file)

    @property
    def _file(self) -> Path | None:
        return None if self.response == PEOPLE else Path(str(self.response))

    def _population(self) -> Population | None:
        if self.usual is None:
            return None
        from scex_sumo.certainty.response.usual import Population

        return Population.read(Path(self.usual))

    def begin(self, job: Job, workers: Workers, options: RunOptions) -> Future[Any] | None:
        """Write the table and the decision in a worker: they need the seed scene alone."""
        if options.is_reference:
            return None
        these = people_apart(job.scene), job.folder
        return workers.submit(partial(self._write, *these), where="in the critical responses", waits=True)

    def after(self, work: Work) -> Sequence[Row]:
        """Write the table and the decision; return P of any collision for the human-like futures."""
        if not work.is_reference:
            if work.begun is None or not succeeded(work.begun):
                self._write(people_apart(work.job.scene), work.job.folder)
            return (Row(name=_ROW, value=None),)
        for name in self.files:
            (work.job.folder / name).unlink(missing_ok=True)
        import pyarrow.parquet as pq

        from scex_sumo.certainty.response.answer import any_collision, once_in

        rows = pq.read_table((work.job.folder.parent / RESPONSE).absolute()).to_pylist()  # of the run itself
        value = any_collision(rows)
        return (Row(name=_ROW, value=once_in(value)),)

    def _write(self, scene: SeedScene, folder: Path) -> None:
        for name in self.files:
            (folder / name).unlink(missing_ok=True)
        import pyarrow.parquet as pq

        from scex_sumo.base.files import replacing, write_atomic
        from scex_sumo.certainty.response.answer import responses_and_maps
        from scex_sumo.certainty.response.decision import decide, with_usual
        from scex_sumo.certainty.response.sensitivity import varied

        table, maps = responses_and_maps(scene, self._file)
        population = self._population()
        if population is not None:
            table = with_usual(table, population, scene.location)
        with replacing(folder / RESPONSE) as temporary:
            pq.write_table(table, temporary)
        decision = decide(
            table.to_pylist(),
            varied=lambda pair: varied(scene, pair, self._file),
        )
        write_atomic(folder / MAPS, json.dumps(maps, allow_nan=False).encode())
        write_atomic(folder / DECISION, json.dumps(dataclasses.asdict(decision)).encode())

    def decision(self, run: Run) -> Decision | None:
        """Return what to test."""
        file = run.folder / DECISION
        if not file.is_file():
            return None
        try:
            content = json.loads(file.read_bytes())
            return Decision(**content | {"pair": content["pair"] and tuple(content["pair"])})
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise ResultError(f"{file}: cannot be read ({str(error)[:80]}); run again") from None

    def lines(self, run: Run) -> Sequence[str]:
        """Return what it takes, of the worst pairs."""
        if not (run.folder / RESPONSE).is_file():
            return ()
        from scex_sumo.certainty.response.answer import TOLD, any_collision, once_in
        from scex_sumo.certainty.response.usual import usual_of
        from scex_sumo.certainty.response.words import needs, sentence

        groups = self._groups(run)[:_WORST]
        rows = [row for row in run.table(RESPONSE).to_pylist() if row["doubt"] and row["probability"] >= TOLD]
        doubts = list(dict.fromkeys(row["doubt"] for row in rows))
        left = [f"  left out as doubtful: {listed(doubts)}"] if doubts else []
        if not groups:
            return (f"{HEAD}: two vehicles collide less than once in 10 million such moments", *left)
        total = any_collision(run.table(RESPONSE).to_pylist())
        head = f"{HEAD}: a collision about {once_in(total)} such moments; what it takes:"
        worst = groups[0][0]
        usual = usual_of(worst.row)
        known = (needs(worst.row), usual and usual.words(worst.probability))
        beside = "; ".join(words for words in known if words)
        place = (f"  {worst.arrow}: {beside}",) if beside else ()
        return (head, *(f"  {sentence(group)}" for group in groups), *place, *left)

    def _groups(self, run: Run) -> Sequence[Sequence[PairResponse]]:
        """Return the pairs that are told, by what is said of them."""
        from scex_sumo.certainty.response.decision import pair_responses
        from scex_sumo.certainty.response.words import grouped

        responses = pair_responses(run.table(RESPONSE).to_pylist())
        return grouped(response for response in responses if response.doubt is None)

    def page(self, run: Run) -> Any:
        """Return the card with what it takes, and the maps of the worst pairs; None without any."""
        lines = self.lines(run)
        if len(lines) < 2:
            return None
        from scex_sumo.certainty.response.page import response_part

        return response_part(lines, run.folder / MAPS)

    def answer(self, run: Run) -> Mapping[str, Any]:
        """Return ``human_like``, what it takes, and ``response``, P of any collision and the table's rows."""
        if not (run.folder / RESPONSE).is_file():
            return super().answer(run)
        from scex_sumo.certainty.response.answer import any_collision
        from scex_sumo.certainty.response.words import sentence

        rows = run.table(RESPONSE).to_pylist()
        groups = self._groups(run)
        return {
            "human_like": [
                {"pairs": [one.pair for one in group], "words": sentence(group)} for group in groups
            ],
            "response": {"collision": any_collision(rows), "pairs": rows},
        }
