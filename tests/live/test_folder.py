"""What is left of a watched simulation: tables, lead times of hand-made conflicts, the page."""

from __future__ import annotations

from pathlib import Path

import pyarrow.parquet as pq
import pytest

from scex_sumo.base.errors import ResultError
from scex_sumo.converters.datasets.find import find_recordings
from scex_sumo.formats.sumo.scenario import RISK
from scex_sumo.live.device import conflicts_of, leads_of
from scex_sumo.live.folder import command_of, worst_moments, write_leads, write_page, write_risks
from scex_sumo.live.risk import PairRisk, Risk

SSM = """<SSMLog>
 <conflict begin="1" end="9" ego="a" foe="b">
  <timeSpan values="4.0 4.1 4.2"/><TTCSpan values="NA 2.9 1.2"/><DRACSpan values="1.0 NA 3.5"/>
  <PET time="NA" value="NA"/>
 </conflict>
 <conflict begin="2" end="9" ego="b" foe="a">
  <timeSpan values="3.5"/><TTCSpan values="3.1"/><DRACSpan values="3.0"/><PET time="6.0" value="1.5"/>
 </conflict>
 <conflict begin="2" end="9" ego="c" foe="d">
  <timeSpan values="5.0"/><TTCSpan values="NA"/><DRACSpan values="NA"/><PET time="8.0" value="0.5"/>
 </conflict>
 <conflict begin="2" end="9" ego="e" foe="f">
  <timeSpan values="5.0"/><TTCSpan values="3.5"/><DRACSpan values="2.9"/><PET time="8.0" value="2.5"/>
 </conflict>
</SSMLog>"""


def risk(time_s: float, *pairs: tuple[str, str, float], vehicles: int = 4) -> Risk:
    found = [
        PairRisk(hits=a, other=b, kind="crossing", human_like=p, stress=0.5, how="b brakes", x=7.4, y=-3.0)
        for a, b, p in pairs
    ]
    return Risk(time_s=time_s, pairs=tuple(found), vehicles=tuple(map(str, range(vehicles))))


def test_lead_time_counts_from_the_first_moment_in_the_ten_seconds_before(tmp_path: Path) -> None:
    file = tmp_path / "ssm.xml"
    file.write_text(SSM)
    risks = [
        risk(1.0, ("b", "a", 5e-5)),  # too seldom
        risk(2.0, ("b", "a", 2e-4), ("x", "y", 1e-3)),
        risk(3.0, ("a", "b", 9e-4)),
        risk(9.0, ("c", "d", 9e-4)),  # after the conflict
    ]
    leads = leads_of(conflicts_of(file), risks)
    told = [(lead.pair, lead.conflict_s, lead.risk_s, lead.lead_s) for lead in leads]
    assert told == [
        (("b", "a"), 3.5, 2.0, 1.5),
        (("c", "d"), 8.0, None, None),
        (("x", "y"), None, 2.0, None),
    ]
    later = leads_of(conflicts_of(file), risks[3:])  # what happened before the watch is none of its conflicts
    assert [lead.conflict_s for lead in later] == []
    rows = pq.read_table(write_leads(tmp_path, leads)).to_pylist()
    assert [row["lead_s"] for row in rows] == [1.5, None, None] and rows[0]["hits"] == "b"


def test_the_page_links_moments_to_the_reports_that_are_there(tmp_path: Path) -> None:
    risks = [risk(1.0), risk(2.5, ("a", "b<script>", 2e-4), vehicles=25)]
    page = write_page(tmp_path, Path("mine.sumocfg"), risks, [], "2 moments").read_text()
    assert 'href="moments' not in page and "--region=7,-3,40" in page  # it has not run yet
    report = tmp_path / "moments" / "2.5" / "report.html"
    report.parent.mkdir(parents=True)
    report.touch()
    page = write_page(tmp_path, Path("mine.sumocfg"), risks, [], "2 moments").read_text()
    assert page.count('href="moments/2.5/report.html"') == 2  # on the time line and in the list
    assert "<script>:" not in page and "once in 5\u202f000" in page
    words = command_of(Path("mine.sumocfg"), Path("out/watch"), *worst_moments(risks)[0])
    assert words == [
        *("run", "out/watch/mine.sumocfg", "--time", "2.5", "--region=7,-3,40"),
        *("-o", "out/watch/moments/2.5"),
    ]
    assert "No moment was assessed" in write_page(tmp_path, Path("m.sumocfg"), [], [], "").read_text()


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
