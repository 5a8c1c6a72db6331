"""In a real browser the report plays, brushes, jumps to encounters, follows thresholds, and saves."""

from __future__ import annotations

import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scex_sumo import example_path
from scex_sumo.page.report import contents
from scex_sumo.page.report.report import write_report
from scex_sumo.page.report.scene import packed_tracks
from scex_sumo.page.report.under_test import under_test_curves
from scex_sumo.reports.card import pair_lines
from scex_sumo.reports.encounter_rows import meetings
from scex_sumo.reports.under_test import under_test_rows
from scex_sumo.results.run import Run, open_run
from scex_sumo.results.under_test import UnderTest
from scex_sumo.scene import LOGGED_HISTORY
from tests.command import scex
from tests.page.conftest import UNFOLD
from tests.page.test_numbers import body


def text(page: Any, selector: str) -> str:
    return str(page.inner_text(selector))


def drag(page: Any, selector: str, start: float, stop: float) -> None:
    """Drag along a canvas, from one share of its width to another."""
    page.locator(selector).scroll_into_view_if_needed()
    box = page.locator(selector).bounding_box()
    y = box["y"] + 0.7 * box["height"]
    page.mouse.move(box["x"] + start * box["width"], y)
    page.mouse.down()
    page.mouse.move(box["x"] + (start + stop) / 2 * box["width"], y)
    page.mouse.move(box["x"] + stop * box["width"], y)
    page.mouse.up()
    page.wait_for_timeout(100)


def test_verdict_row_map_caption_and_look_are_of_one_pair(answered: Run, tab: tuple[Any, list[str]]) -> None:
    told, (page, wrong) = answered.decision, tab
    assert told is not None and told.pair is not None and told.time_s is not None
    page.goto("about:blank")
    wrong.clear()
    page.set_viewport_size({"width": 1440, "height": 900})
    page.emulate_media(reduced_motion="reduce")
    page.goto((answered.folder / "report.html").resolve().as_uri())
    page.wait_for_selector("#pairs tr.chosen")
    names = " → ".join(map(str, told.pair))
    assert names in text(page, "#answer") and told.how is not None and told.how in text(page, "#answer")
    assert text(page, "#pairs tr.chosen td >> nth=0") == names
    assert text(page, "#caption").startswith(f"{names}: {told.how}; people collide about once in ")
    assert text(page, "#caption").endswith(f"human-like future {told.future}")
    assert text(page, "#clock") == f"{told.time_s:.1f} s"
    assert text(page, "#answers code") == f"scex-sumo view {answered.folder}"  # of the same pair
    shown = page.locator("#pairs tbody tr").all()
    assert [line.locator("td").all_inner_texts() for line in shown] == [
        list(line.cells) for line in pair_lines(answered)
    ]
    for line, row in zip(pair_lines(answered), shown, strict=True):
        row.click()
        page.wait_for_selector(f"#caption:has-text('{line.label}')")
        assert text(page, "#caption").startswith(line.caption)
        assert text(page, "#clock") == f"{line.after_s:.1f} s"
    assert wrong == []


@pytest.mark.parametrize(("width", "height"), [(1440, 900), (1024, 768), (390, 844)])
def test_the_first_screen_has_verdict_film_and_pairs(
    browser: Any, answered: Run, width: int, height: int
) -> None:
    page = browser.new_page(viewport={"width": width, "height": height}, reduced_motion="reduce")
    page.goto((answered.folder / "report.html").resolve().as_uri())
    page.wait_for_selector("#pairs tr.chosen")
    answer, film, row = (
        page.locator(name).bounding_box() for name in ("#answer", "#map", "#pairs tr.go >> nth=2")
    )
    assert answer["y"] < film["y"] and row["y"] + row["height"] <= height
    assert film["width"] * film["height"] > 0.2 * width * height
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    assert page.locator("details[open]").count() == 0
    page.close()


def test_printed_it_is_one_or_two_pages_with_the_film_and_without_controls(
    browser: Any, answered: Run
) -> None:
    page = browser.new_page(reduced_motion="reduce")
    page.goto((answered.folder / "report.html").resolve().as_uri())
    page.wait_for_selector("#pairs tr.chosen")
    assert len(re.findall(rb"/Type\s*/Page\b", page.pdf(prefer_css_page_size=True))) in (1, 2)
    page.emulate_media(media="print")
    assert page.locator("#map").is_visible() and page.locator("#pairs").is_visible()
    assert not any(page.locator(name).is_visible() for name in ("#play", "#time", "#tools", "#mapbuttons"))
    page.close()


def test_abbreviations_say_what_they_mean(page: Any) -> None:
    words = page.eval_on_selector_all(
        "abbr", "(all) => all.map(({ textContent, title }) => [textContent, title])"
    )
    known = dict(words)
    assert known["WTTC"] == "worst-case time to collision" and {"TTC", "DRAC", "THW"} <= set(known)


BACK = """
    const real = requestAnimationFrame;
    let frames = 0;
    window.requestAnimationFrame = (act) => real((now) => act(now - (++frames % 3 ? 0 : 5000)));
"""


def test_films_play_with_stamps_that_go_back(browser: Any, answered: Run) -> None:
    page, wrong = browser.new_page(), list[str]()
    page.on("pageerror", lambda error: wrong.append(str(error)))
    page.add_init_script(BACK)
    for _ in range(3):
        page.goto("about:blank")
        page.goto((answered.folder / "report.html").resolve().as_uri())
        page.wait_for_function("() => ['0.1 s', '0.2 s', '0.3 s'].includes(clock.textContent)")
    assert wrong == []
    page.close()


def test_it_opens_on_the_worst_encounter_with_the_play_bar_in_sight(page: Any, run: Run) -> None:
    worst = run.encounters.to_pylist()[0]
    page.wait_for_selector("#encounters tr.chosen")
    assert page.input_value("#future") == str(worst["future"])
    assert text(page, "#clock") == f"{worst['time_s']:.1f} s"
    title = text(page, "#pair-title")
    assert str(worst["track_id"]) in title and title.endswith(f"future {worst['future']}")
    chosen = text(page, "#encounters tr.chosen td >> nth=0")
    assert chosen == f"{worst['track_id']} → {worst['other_id']}"
    for name in ("#play", "#time", "#caption"):
        box = page.locator(name).bounding_box()
        assert box["y"] + box["height"] <= 900
    places = [_on_map(page, run, worst[name]) for name in ("track_id", "other_id")]
    assert all(place is not None for place in places)


def _on_map(page: Any, run: Run, track: int) -> tuple[float, float] | None:
    """Return a place in the middle of the map where the pointer finds a vehicle."""
    box = page.locator("#map").bounding_box()
    for ring in range(32):
        for turn in np.arange(0, 2 * np.pi, np.pi / 6):
            x = box["x"] + box["width"] / 2 + 10 * ring * np.cos(turn)
            y = box["y"] + box["height"] / 2 + 10 * ring * np.sin(turn)
            page.mouse.move(x, y)
            if page.get_attribute("#map", "title").startswith(f"vehicle {track}:"):
                return float(x), float(y)
    return None


def test_a_vehicle_says_its_id_speed_and_model(page: Any, run: Run) -> None:
    worst = run.encounters.to_pylist()[0]
    track, future, step = worst["track_id"], worst["future"], round(worst["time_s"] * 10)
    assert _on_map(page, run, track) is not None
    vehicle = run.info["seed_scene"]["track_ids"].index(track)
    said = page.get_attribute("#map", "title").split(", ")
    assert abs(float(said[1].removesuffix(" m/s")) - run.states(future).speed[vehicle, 10 - 1 + step]) < 0.07
    assert said[-1] == run.models_of(future)[vehicle]


def test_an_encounter_leads_to_its_pair_future_and_step(page: Any) -> None:
    row = page.locator("#encounters tr.go").nth(1)
    pair = row.locator("td").first.inner_text().split(" → ")
    row.click()
    page.wait_for_selector("#encounters tr.chosen >> nth=0")
    page.wait_for_selector(f"#pair-title:has-text('{pair[0]}')")
    title = text(page, "#pair-title")
    assert title.startswith(f"{pair[0]} ") and f" and {pair[1]} " in title
    assert text(page, "#clock") == row.locator("td").last.inner_text()


def test_curves_have_the_values_of_the_run_at_the_shown_step(page: Any, run: Run) -> None:
    row = run.encounters.to_pylist()[0]
    seen = [run.info["seed_scene"]["track_ids"].index(row[name]) for name in ("track_id", "other_id")]
    states, scene = run.states(row["future"]), run.scene
    page.keyboard.press("ArrowLeft")
    step = round(10 * row["time_s"]) - 1
    page.wait_for_selector(f"#clock:has-text('{step / 10:.1f} s')")
    speed, acceleration, gap, _ = page.locator("#strips header span:last-child").all_inner_texts()
    now = states[seen, LOGGED_HISTORY - 1 + step]
    np.testing.assert_allclose([float(v) for v in speed.split(" / ")], now.speed, atol=0.07)
    around = [states.speed[seen, LOGGED_HISTORY - 1 + step + by] for by in (-1, 1)]
    np.testing.assert_allclose(
        [float(v) for v in acceleration.split(" / ")], (around[1] - around[0]) / 0.2, atol=0.16
    )
    bodies = [
        body(np.array([now.x[i], now.y[i], now.heading[i]]), np.array([scene.length[v], scene.width[v]]))
        for i, v in enumerate(seen)
    ]
    assert abs(float(gap) - bodies[0].distance(bodies[1])) < 0.07
    cursor = page.eval_on_selector(".strip i", "cursor => cursor.style.left")
    assert float(cursor.removesuffix("%")) == pytest.approx(100 * step / run.info["steps"])
    page.locator(".strip canvas").last.click(position={"x": 1, "y": 20})
    page.wait_for_selector("#clock:has-text('0.0 s')")


def test_a_pair_alone_filters_tables_and_p_and_its_chip_stays_in_sight(page: Any, run: Run) -> None:
    row = run.encounters.to_pylist()[0]
    pair = {row["track_id"], row["other_id"]}
    futures = critical_futures(run, pair)["critical"]
    page.click("#only-pair")
    page.wait_for_selector(".chip")
    assert text(page, "#chips b").startswith(f"{len(futures)} of {run.futures} futures")
    collided = len(futures & set(run.collisions["future"].to_pylist()))
    assert f"P(collision) {100 * collided / len(futures):.0f} % stress test" in text(page, "#chips b")
    assert page.locator("#encounters tbody tr").count() == 1
    assert page.locator("#models tbody tr").count() == 2
    shown = page.locator("#worst tbody tr td:first-child").all_inner_texts()
    assert {frozenset(names.split(" – ")) for names in shown} <= {frozenset(map(str, pair))}
    page.evaluate("scrollTo(0, document.body.scrollHeight)")
    assert 0 <= page.locator(".chip").bounding_box()["y"] < 60
    page.keyboard.press("Escape")
    page.wait_for_selector(".chip", state="detached")
    assert page.locator("#encounters tbody tr").count() == run.encounters.num_rows


def critical_futures(run: Run, pair: set[int]) -> dict[str, set[int]]:
    """Return the futures in which a pair is critical, by question."""
    hits = {r["future"] for r in run.collisions.to_pylist() if {r["track_id"], r["other_id"]} == pair}
    met = [r for r in run.pair_outcomes.to_pylist() if {r["track_a"], r["track_b"]} == pair]
    found = {
        "collision": hits,
        "ttc": hits | {r["future"] for r in met if r["min_ttc_path"] < 1.5},
        "pet": hits | {r["future"] for r in met if r["min_pet"] < 1.0},
        "drac": hits | {r["future"] for r in met if r["max_drac"] > 3.4},
    }
    return {**found, "critical": set.union(*found.values())}


def test_every_number_of_the_encounters_follows_a_selection(page: Any, run: Run) -> None:
    ids = run.info["seed_scene"]["track_ids"]
    page.evaluate("location.hash = 'only.v2=0&only.v4=0'")
    page.wait_for_selector(".chip >> nth=1")
    tracks = [text(page, f".chip >> nth={n}").removesuffix(" ×").split(" as ") for n in (0, 1)]
    drives = [
        [run.models_of(future)[ids.index(int(track))] == model for track, model in tracks]
        for future in range(run.futures)
    ]
    chosen = {future for future, both in enumerate(drives) if all(both)}
    assert 0 < len(chosen) < run.futures
    rows = page.locator("#encounters tbody tr").all()
    assert rows
    for line in rows:
        pair, *cells = line.locator("td").all_inner_texts()
        futures = critical_futures(run, {int(track) for track in pair.split(" → ")})
        shown = [cells[0], *cells[2:5]]
        for name, cell in zip(("collision", "ttc", "pet", "drac"), shown, strict=True):
            share = 100 * len(futures[name] & chosen) / len(chosen)
            assert cell in (f"{share:.0f} %", f"{share:.1f} %"), (pair, name)
        assert "–" in cells[1]
    gap, after = rows[0].locator("td").all_inner_texts()[-2:]
    rows[0].click()
    page.wait_for_selector(f"#clock:has-text('{after}')")
    assert int(page.input_value("#future")) in chosen
    page.wait_for_function("() => document.querySelectorAll('.strip header span:last-child')[2].innerText")
    assert page.locator(".strip header span:last-child").nth(2).inner_text() == gap.removesuffix(" m")


def test_human_like_encounters_play_and_the_legend_says_which_set_is_shown(
    browser: Any, run: Run, tmp_path: Path
) -> None:
    copy = tmp_path / "out"
    shutil.copytree(run.folder, copy)
    shutil.copytree(run.folder, copy / "reference")
    both = open_run(copy)
    page = browser.new_page(viewport={"width": 1400, "height": 900}, reduced_motion="reduce")
    page.goto(write_report(both).resolve().as_uri())
    page.evaluate(UNFOLD)
    page.wait_for_selector("#encounters tr.chosen")
    row = meetings(both)[1]
    assert row.futures == "human-like"
    assert text(page, "#caption").endswith(f"stress test, future {row.row['future']}")
    page.locator("#encounters tr.go").nth(1).click()
    page.wait_for_selector("#caption:has-text('human-like')")
    assert text(page, "#caption").endswith(f"human-like future {row.row['future']}")
    assert text(page, "#pair-title").endswith(f"human-like future {row.row['future']}")
    assert text(page, "#encounters tr.chosen td >> nth=1") == "human-like"
    assert page.locator("#encounters tr.chosen").count() == 1
    page.wait_for_function("() => location.hash.includes('future=h')")
    page.keyboard.press("ArrowLeft")
    step = round(10 * row.row["time_s"]) - 1
    page.wait_for_selector(f"#clock:has-text('{step / 10:.1f} s')")
    seen = [both.info["seed_scene"]["track_ids"].index(row.row[name]) for name in ("track_id", "other_id")]
    speed = both.reference.states(row.row["future"]).speed[seen, LOGGED_HISTORY - 1 + step]  # type: ignore[union-attr]
    said = page.locator(".strip header span:last-child").first.inner_text()
    np.testing.assert_allclose([float(v) for v in said.split(" / ")], speed, atol=0.07)
    page.click("#only-pair")
    page.wait_for_selector(".chip")
    hits = critical_futures(both, set(row.pair))
    share = f"{100 * len(hits['collision']) / len(hits['critical']):.0f} %"
    assert text(page, "#chips b").endswith(f"P(collision) {share} stress test, {share} human-like")
    page.close()


def test_a_future_without_tracks_says_how_it_is_seen(
    browser: Any, run: Run, tmp_path: Path, monkeypatch: Any
) -> None:
    copy = tmp_path / "out"
    shutil.copytree(run.folder, copy)
    monkeypatch.setattr(contents, "packed_tracks", lambda wanted: packed_tracks(wanted, budget=1))
    page = browser.new_page(reduced_motion="reduce")
    page.goto(write_report(open_run(copy)).resolve().as_uri())
    page.evaluate(UNFOLD)
    page.wait_for_selector("#encounters tr.chosen")
    worst = run.encounters.to_pylist()[0]["future"]
    assert page.input_value("#future") == str(worst)
    other = (worst + 1) % run.futures
    page.fill("#future", str(other))
    page.locator("#future").blur()
    page.wait_for_selector("#said:has-text('no tracks')")
    assert text(page, "#said").endswith(f"--future {other}")
    page.keyboard.press("Space")
    page.keyboard.press("ArrowDown")
    page.wait_for_timeout(100)
    assert page.input_value("#future") == str(worst)
    page.close()


def test_a_future_alone_filters_p_and_the_worst_futures(page: Any, run: Run) -> None:
    future = run.encounters.to_pylist()[0]["future"]
    page.click("#only-future")
    page.wait_for_selector(".chip")
    assert text(page, "#chips b").split("P(collision) ")[1] in ("0 % stress test", "100 % stress test")
    value, limit = run.metrics["wttc"][future].as_py(), run.thresholds["wttc"]
    share = page.locator(".chart:has-text('WTTC') b").first.inner_text()
    assert share == ("100 %" if value <= limit else "0 %")
    assert set(page.locator("#worst tbody tr td:last-child").all_inner_texts()) <= {str(future)}


def test_a_brushed_metric_selects_the_futures_everywhere(page: Any, run: Run) -> None:
    drag(page, "#charts .chart:first-child canvas", 0.02, 0.3)
    chosen = int(text(page, "#chips b").split(" of ")[0])
    assert 0 < chosen < run.futures
    page.keyboard.press("ArrowDown")
    page.wait_for_timeout(100)
    first = int(page.input_value("#future"))
    assert run.metrics["distance"][first].as_py() < 0.4 * max(run.samples("distance"))
    page.keyboard.press("Escape")
    page.wait_for_timeout(100)
    assert text(page, "#chips") == ""


def test_a_threshold_that_is_dragged_back_has_the_share_of_the_table_again(page: Any, run: Run) -> None:
    share = "#charts .chart:first-child b"
    limit, before = float(page.input_value(LIMIT)), page.get_attribute(share, "title")
    page.fill(LIMIT, str(limit + 2))
    page.locator(LIMIT).blur()
    page.wait_for_function(f"before => document.querySelector('{share}').title !== before", arg=before)
    page.fill(LIMIT, str(limit + 0.05))
    page.locator(LIMIT).blur()
    page.wait_for_timeout(100)
    canvas, at = "#charts .chart:first-child canvas", _grip(page)
    drag(page, canvas, at, at + 0.01)
    found = run.p_critical("distance")
    assert float(page.input_value(LIMIT)) == limit
    assert page.get_attribute(share, "title") == before
    assert f"95 %: {found.range} %" in before


LIMIT = "#charts .chart:first-child input"
ROWS = "count => document.querySelectorAll('#encounters tbody tr').length === count"


def _grip(page: Any) -> float:
    """Where the first chart's threshold is, as a share of its width."""
    canvas = "#charts .chart:first-child canvas"
    page.evaluate("document.querySelector('#charts .chart input').scrollIntoView()")
    find = """canvas => {
        const { left, top, width } = canvas.getBoundingClientRect();
        const isGrip = (x) => {
            canvas.dispatchEvent(new PointerEvent("pointermove", { clientX: left + x, clientY: top + 60 }));
            return canvas.style.cursor === "ew-resize";
        };
        return ([...Array(Math.floor(width)).keys()].find(isGrip) + 9) / width;
    }"""
    return float(page.eval_on_selector(canvas, find))


@pytest.mark.parametrize(
    ("button", "ending", "start"),
    [("#save-png", ".png", b"\x89PNG"), ("#save-webm", ".webm", b"\x1aE\xdf\xa3")],
)
def test_pictures_and_films_are_saved(
    page: Any, tmp_path: Path, button: str, ending: str, start: bytes
) -> None:
    page.select_option("#speed", "2")
    with page.expect_download(timeout=15_000) as waiting:
        page.click(button)
    saved = tmp_path / "saved"
    waiting.value.save_as(saved)
    assert waiting.value.suggested_filename.endswith(ending)
    assert saved.read_bytes().startswith(start)
    assert saved.stat().st_size > 5_000


def test_the_driver_under_test_has_its_table_and_curves(browser: Any, tmp_path: Path) -> None:
    words = (
        "--futures",
        12,
        "--reference",
        "none",
        "--under-test",
        "7=emergency_brake",
        "-o",
        tmp_path / "out",
    )
    scex("run", example_path("roundabout"), *words).check_returncode()
    run, page = open_run(tmp_path / "out"), browser.new_page(viewport={"width": 1400, "height": 900})
    page.goto((run.folder / "report.html").resolve().as_uri())
    page.wait_for_selector("#under-test td")
    rows = under_test_rows(UnderTest.of(run))
    assert page.locator("#under-test td:first-child").all_inner_texts() == [row[0] for row in rows]
    canvases = page.locator("#tested-curves canvas")
    assert canvases.count() == len(under_test_curves(run, UnderTest.of(run)))
    drawn = """canvas => {
        const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
        return new Set(new Uint32Array(data.buffer)).size;
    }"""
    assert canvases.first.evaluate(drawn) > 10
    page.close()
