"""What is left of a watched simulation: the table, the page."""

from __future__ import annotations

from pathlib import Path

import pytest

from scex_sumo.base.errors import ResultError
from scex_sumo.converters.datasets.find import find_recordings
from scex_sumo.formats.sumo.scenario import RISK
from scex_sumo.live.folder import command_of, worst_moments, write_page, write_risks
from scex_sumo.live.risk import PairRisk, Risk


def risk(time_s: float, *pairs: tuple[str, str, float], vehicles: int = 4) -> Risk:
    found = [
        PairRisk(hits=a, other=b, kind="crossing", human_like=p, stress=0.5, how="b brakes", x=7.4, y=-3.0)
        for a, b, p in pairs
    ]
    return Risk(time_s=time_s, pairs=tuple(found), vehicles=tuple(map(str, range(vehicles))))


def test_the_page_links_moments_to_the_reports_that_are_there(tmp_path: Path) -> None:
    risks = [risk(1.0), risk(2.5, ("a", "b<script>", 2e-4), vehicles=25)]
    page = write_page(tmp_path, Path("mine.sumocfg"), risks, "2 moments").read_text()
    assert 'href="moments' not in page and "--region=7,-3,40" in page  # it has not run yet
    report = tmp_path / "moments" / "2.5" / "report.html"
    report.parent.mkdir(parents=True)
    report.touch()
    page = write_page(tmp_path, Path("mine.sumocfg"), risks, "2 moments").read_text()
    assert page.count('href="moments/2.5/report.html"') == 2  # on the time line and in the list
    assert "<script>:" not in page and "once in 5\u202f000" in page
    words = command_of(Path("mine.sumocfg"), Path("out/watch"), *worst_moments(risks)[0])
    assert words == [
        *("run", "out/watch/mine.sumocfg", "--time", "2.5", "--region=7,-3,40"),
        *("-o", "out/watch/moments/2.5"),
    ]
    assert "No moment was assessed" in write_page(tmp_path, Path("m.sumocfg"), [], "").read_text()


def test_rank_takes_the_moments_that_a_watch_found_critical_the_worst_first(tmp_path: Path) -> None:
    found = [risk(1.0, ("a", "b", 1e-6)), risk(2.0), risk(3.0, ("a", "b", 1e-3), ("a", "c", 1e-9))]
    write_risks(tmp_path, found)
    (tmp_path / "mine.sumocfg").write_text("<configuration/>")
    (recording,) = find_recordings(tmp_path)
    assert (recording.times, recording.window) == ((3.0, 1.0), (1.0, 3.0))
    assert recording.within((None, 2.0)).window == (1.0, 2.0)
    (tmp_path / RISK).write_bytes(b"PAR1")
    with pytest.raises(ResultError, match=r"risk\.parquet: cannot be read"):
        find_recordings(tmp_path)
