"""Exact probabilities as an extra of a run: its methods."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from scex_sumo.base.errors import ScexError
from scex_sumo.certainty.fitted import answer_of, fitted_weights, percent_of, write_fitted
from scex_sumo.certainty.options import EXACT, FITTED, ExactProbabilities
from scex_sumo.certainty.page import exact_part
from scex_sumo.certainty.results import Exact, exact_of, write_exact
from scex_sumo.extrapolation.extras import Work
from scex_sumo.metrics.events import EVENTS
from scex_sumo.results.extras import ExactProbability, Row
from scex_sumo.results.run import Run


class ExactExtra(ExactProbabilities):
    """Exact probabilities with their methods."""

    def settle(self, work: Work) -> Any:
        """Return the influence tables of the futures so far, if any collision has an exact probability."""
        exact = self._searched(work)
        return None if exact is None or exact.probability() is None else exact

    def after(self, work: Work) -> Sequence[Row]:
        """Find the influence tables and write them to ``exact.json``."""
        file = work.job.folder / EXACT
        file.unlink(missing_ok=True)
        exact = work.settled or self._searched(work)
        if exact is not None:
            write_exact(exact, file)
        return ()

    def finish(self, run: Run, work: Work) -> Mapping[str, Path]:
        """Fit the weights to the recording and write them to ``fitted_weights.json``."""
        (run.folder / FITTED).unlink(missing_ok=True)
        if self.fit_weights and sum(entry["weight"] > 0 for entry in run.info["models"]) > 1:
            try:
                write_fitted(run.folder, fitted_weights(run))
            except ScexError as error:  # the run is finished
                run.info["run_notes"].append(f"weights are not fitted: {error}")
        return {}

    def lines(self, run: Run) -> Sequence[str]:
        """Return P of any collision with the weights fitted to the recording."""
        answer = self.answer(run)
        if not answer:
            return ()
        fitted = answer["fitted_weights"]
        share = percent_of(fitted["p_collision"])
        how = f"weights fitted to the recording ({fitted['words']})"
        return [f"stress test, {how}: a collision in {share} of futures"]

    def answer(self, run: Run) -> Mapping[str, Any]:
        """Return the fitted weights, and P of any collision with them."""
        if not (run.folder / FITTED).is_file():
            return {}
        return {"fitted_weights": answer_of(run)}

    def _searched(self, work: Work) -> Any:
        if not self.exact:
            return None
        from scex_sumo.certainty.exact import find_exact, why_not_exact

        job = work.job
        if why_not_exact(job.settings, job.models, len(job.assignment)) is not None:
            return None
        assert work.part.encounters is not None
        return find_exact(job, work.part.encounters, work.workers)

    def exact_probability(
        self, run: Run, event: str, pair: tuple[int, int] | None
    ) -> ExactProbability | None:
        """Return the exact probability of an event with its cut sets, if its pairs have tables."""
        exact = _tables(run)
        value = None if exact is None else exact.probability(event, pair)
        if exact is None or value is None:
            return None
        table = exact.table(*pair, event) if pair is not None and event in EVENTS else None
        if table is None:
            return ExactProbability(value=value, checked=exact.summary(), remainder=exact.remainder)
        ways = tuple(table.in_words())
        return ExactProbability(value=value, checked=table.summary(), remainder=table.remainder, ways=ways)

    def pair_lines(self, run: Run, row: Mapping[str, Any]) -> Sequence[str]:
        """Return the cut sets of a collision, and whose models matter how much."""
        exact = _tables(run)
        pair = row["track_id"], row["other_id"]
        table = None if exact is None else exact.table(*pair)
        if exact is not None and (why := exact.why_sampled(*pair)):
            return [f"no exact table of the collision: {why}"]
        if table is None or table.probability() == 0:
            return ()
        lines = [f"collides exactly if ({table.summary()}):", *(f"  {words}" for words in table.in_words())]
        for track, models in table.leverage().items():
            most = max(models, key=lambda model: abs(models[model]))
            lines.append(f"  {track}: P changes by {models[most]:+.3f} per share of {most}")
        return lines

    def page(self, run: Run) -> Any:
        """Return the card with a slider for each model's weight; None where no pair collides."""
        return None if _tables(run) is None else exact_part(run)


def _tables(run: Run) -> Exact | None:
    return exact_of(run) if (run.folder / EXACT).is_file() else None
