from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from scex_sumo.base.errors import ScexError, UsageError
from scex_sumo.drivers.registry import build, parse_models
from scex_sumo.plug_in.files import ProcessDriver, split_command
from scex_sumo.road import Road
from scex_sumo.scenarios import example_path
from scex_sumo.scenarios.seeds import read_seed
from scex_sumo.scene import SceneHistory
from tests.converters.sumo_roads import lane
from tests.runs import extrapolate
from tests.seeds import straight_seed

EXAMPLES = Path(__file__).resolve().parents[2] / "docs" / "examples"
PYTHON = shlex.join([sys.executable, str(EXAMPLES / "process_driver.py")])
ROAD = Road(name="none", lanes={})


def ask(driver: ProcessDriver) -> object:
    history = SceneHistory.of_scene(straight_seed())
    return driver.plan_one(history, ROAD, 0, 0, np.random.default_rng(0))


def program(tmp_path: Path, after_setup: str) -> str:
    file = tmp_path / "driver.py"
    text = f"import sys, time, os\nsys.stdin.readline()\nprint('{{}}', flush=True)\n{after_setup}\n"
    file.write_text(text)
    return shlex.join([sys.executable, str(file)])


def test_the_python_example_drives_straight_on() -> None:
    history = SceneHistory.of_scene(straight_seed())
    plan = ProcessDriver(PYTHON).plan_one(history, ROAD, 0, 1, np.random.default_rng(0))
    np.testing.assert_allclose(plan.x, np.arange(1, 31), atol=1e-9)  # 10 m/s
    np.testing.assert_allclose(plan.y, 10.0)


def test_the_c_plus_plus_example_brakes_and_answers_within_a_millisecond(tmp_path: Path) -> None:
    compiler = shutil.which("g++")
    if compiler is None:
        pytest.skip("no C++ compiler here")
    binary = tmp_path / "driver"
    subprocess.run([compiler, "-O2", "-o", binary, EXAMPLES / "process_driver.cpp"], check=True)
    driver, history = ProcessDriver(str(binary)), SceneHistory.of_scene(straight_seed(10))
    plan = driver.plan_one(history, ROAD, 0, 0, np.random.default_rng(0))
    np.testing.assert_allclose(plan.speed, 10.0 - 0.2 * np.arange(1, 31), atol=1e-6)
    times = []
    for _ in range(50):
        start = time.perf_counter()
        driver.plan_one(history, ROAD, 0, 0, np.random.default_rng(0))
        times.append(time.perf_counter() - start)
    assert min(times) < 0.001


@pytest.mark.parametrize(
    ("does", "message"),
    [
        ("sys.stdin.readline(); time.sleep(60)", "no answer within 0.5 s"),
        ("sys.stdin.readline()\nwhile True: sys.stdout.write('x' * 65536)", "without the end of a line"),
        (
            "sys.stdin.readline()\nwhile print('x', end='', flush=True) is None: time.sleep(0.01)",
            "no answer within",
        ),
        ("sys.stdin.readline(); print('{}\\n{}', flush=True)", "more than one line"),
        ("sys.stdin.readline(); os._exit(3)", "the program has ended with status 3"),
        ("sys.stdin.readline(); print('hello', flush=True)", "its answer is not JSON: b'hello'"),
        ("sys.stdin.readline(); print('{\"x\": [1]}', flush=True)", "its answer is not a plan; needs x, y"),
    ],
)
def test_a_program_that_is_late_crashes_or_talks_garbage_is_said_to(
    does: str, message: str, tmp_path: Path
) -> None:
    with pytest.raises(ScexError, match=message):
        ask(ProcessDriver(program(tmp_path, does), deadline_s=0.5))


def test_a_program_that_reads_nothing_does_not_stop_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("scex_sumo.plug_in.files.START_S", 0.3)
    file = tmp_path / "deaf.py"
    file.write_text("import time\ntime.sleep(60)\n")
    road = Road(name="large", lanes={1: lane(1, [(float(k), 0.0) for k in range(20_000)])})  # fills the pipe
    driver = ProcessDriver(shlex.join([sys.executable, str(file)]))
    with pytest.raises(ScexError, match=r"no answer within 0.3 s"):
        driver.plan_one(SceneHistory.of_scene(straight_seed()), road, 0, 0, np.random.default_rng(0))


def test_a_program_that_never_gets_ready_is_waited_for_once_and_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("scex_sumo.plug_in.files.START_S", 0.5)
    monkeypatch.setattr("scex_sumo.plug_in.files.QUIET_S", 0.1)
    driver = ProcessDriver("sleep 60")
    for _ in range(2):
        start = time.monotonic()
        with pytest.raises(ScexError, match=r"no answer within 0.5 s; it must answer the first line"):
            ask(driver)
    assert time.monotonic() - start < 0.3  # it was not started again
    assert capsys.readouterr().err == "waiting up to 0.5 s for the program sleep 60\n"


def test_the_command_keeps_its_colons_commas_and_blanks() -> None:
    assert split_command("deadline_s=0.5:./a b:c,d") == ["deadline_s=0.5", "command=./a b:c,d"]
    (spec,) = parse_models("process:./a b:c,d")
    assert spec.parameters == {"command": "./a b:c,d"}
    assert parse_models(str(spec)) == [spec]
    with pytest.raises(UsageError, match="needs more than 0 s"):
        build(parse_models("process:deadline_s=0:./a")[0])


def test_a_weight_ends_a_command_and_other_models_follow() -> None:
    specs = parse_models("process:python a,b@2,standard_driver,process:./mail@host")
    assert [(spec.name, spec.parameters.get("command"), spec.weight) for spec in specs] == [
        ("process", "python a,b", 2.0),
        ("standard_driver", None, 1.0),
        ("process", "./mail@host", 1.0),
    ]


def test_a_run_counts_what_the_program_did_not_answer(tmp_path: Path) -> None:
    scene = read_seed(example_path("motorway_merge"))
    track = int(scene.track_ids[0])
    fine = extrapolate(scene, futures=2, assign={track: f"process:{PYTHON}"}, out=tmp_path / "a")
    assert fine.models_of(0)[0].startswith("process:") and not fine.info["run_notes"]
    with pytest.raises(UsageError, match="no future 2; there are 0 to 1"):
        fine.models_of(2)
    does = "sys.stdin.readline(); print('{}', flush=True)"  # the try before the run is answered with no plan
    with pytest.raises(ScexError, match="no usable plan for any of") as refused:
        extrapolate(
            scene, futures=2, assign={track: f"process:{program(tmp_path, does)}"}, out=tmp_path / "b"
        )
    text = str(refused.value)
    assert "plug_in" not in text and "a Plan has" not in text and len(text) < 300


WRAPPER = """#!/bin/sh
(while :; do :; done) &
exec "$@"
"""


def wrapped(tmp_path: Path) -> str:
    """The example behind a shell script that leaves a spinning process behind."""
    script = tmp_path / "wrapper.sh"
    script.write_text(WRAPPER)
    script.chmod(0o755)
    return shlex.join([str(script), sys.executable, str(EXAMPLES / "process_driver.py")])


def is_there(group: int) -> bool:
    until = time.monotonic() + 10.0
    while time.monotonic() < until:
        try:
            os.killpg(group, 0)
        except ProcessLookupError:
            return False
        time.sleep(0.02)
    return True


def test_what_a_program_has_started_ends_with_it(tmp_path: Path) -> None:
    driver = ProcessDriver(wrapped(tmp_path))
    ask(driver)
    assert driver._program is not None
    group = driver._program._process.pid
    driver._program.end()
    assert not is_there(group)


def test_what_a_program_has_started_ends_with_a_worker_that_is_killed(tmp_path: Path) -> None:
    script = (
        "import sys, time\nfrom tests.plug_in.test_process import ask, ProcessDriver\n"
        "driver = ProcessDriver(sys.argv[1])\nask(driver)\n"
        "print(driver._program._process.pid, flush=True)\ntime.sleep(60)\n"
    )
    command = [sys.executable, "-c", script, wrapped(tmp_path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as worker:
        assert worker.stdout is not None
        group = int(worker.stdout.readline())
        worker.kill()
    assert not is_there(group)
