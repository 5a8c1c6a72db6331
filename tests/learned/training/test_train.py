"""Training runs on recordings of our own: they learn, go on where they stopped, and notice bad tracks."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from scex_sumo.base.errors import ResultError, TrackError, UsageError  # noqa: E402
from scex_sumo.base.files import cache_folder  # noqa: E402
from scex_sumo.converters.datasets.find import find_recordings  # noqa: E402
from scex_sumo.converters.registries import Recording  # noqa: E402
from scex_sumo.evaluation.recordings import load_recording  # noqa: E402
from scex_sumo.evaluation.split import Split  # noqa: E402
from scex_sumo.learned.network.architecture import Architecture  # noqa: E402
from scex_sumo.learned.network.weights import load_weights  # noqa: E402
from scex_sumo.learned.training.command import train_command  # noqa: E402
from scex_sumo.learned.training.data import dataset as dataset_module  # noqa: E402
from scex_sumo.learned.training.data.batches import Images, turned  # noqa: E402
from scex_sumo.learned.training.data.dataset import Dataset, SampleOptions, make_dataset, part_scenes  # noqa: E402
from scex_sumo.learned.training.train import Progress, Trainer, TrainOptions  # noqa: E402
from scex_sumo.scenarios import example_path  # noqa: E402

SMALL = {"hidden": 16, "heads": 2, "layers": 1}
# The examples last 18 s: half of it for training is 9 s, of which the last 5 s are targets.
SAMPLING = SampleOptions(copies=1, stops=1, split=Split(validation=0.45, test=0.0))
CPU = torch.device("cpu")


@pytest.fixture(autouse=True, scope="module")
def one_thread() -> Iterator[None]:
    """Small networks gain nothing from threads, and wait for each other on a busy machine."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


def merge() -> list[Recording]:
    (one,) = (
        r for r in find_recordings([example_path("motorway_merge").parent]) if r.name == "motorway_merge"
    )
    return [one]


@pytest.fixture(scope="module")
def small() -> Dataset:
    return make_dataset(merge(), SAMPLING)


def options(**given: object) -> TrainOptions:
    usual = {"kind": "graph", "epochs": 2, "rounds": 0, "nodes": 100, "sizes": Architecture(**SMALL)}
    return TrainOptions(**{**usual, **given})


def trained(
    small: Dataset, given: TrainOptions, folder: Path | None = None, stop: int | None = None
) -> tuple[Trainer, list[Progress]]:
    """A run, in closed loop with the first graphs as what it drifted to; interrupted after an epoch."""
    part = dataset_module.TrainingSamples.concatenate([small.train])
    run = Trainer(small, given, device=CPU, drift=lambda file, number: part, folder=folder)
    run.resume()
    log: list[Progress] = []

    def report(progress: Progress) -> None:
        log.append(progress)
        if progress.epoch == stop:
            raise KeyboardInterrupt

    try:
        run.run(report)
    except KeyboardInterrupt:
        assert stop is not None
    return run, log


def weights(run: Trainer) -> dict[str, np.ndarray]:
    return {name: value.numpy() for name, value in run.finished().state_dict().items()}


def assert_same(one: dict[str, np.ndarray], other: dict[str, np.ndarray]) -> None:
    assert one.keys() == other.keys()
    for name in one:
        np.testing.assert_array_equal(one[name], other[name], err_msg=name)


def test_the_loss_falls(small: Dataset) -> None:
    _, log = trained(small, options(epochs=4))
    first, last = (sum(progress.parts.values()) for progress in (log[0], log[-1]))
    assert last < 0.8 * first  # an untrained network is metres off after 3 s


def test_the_same_seed_gives_the_same_weights_and_another_others(small: Dataset) -> None:
    once, again = (weights(trained(small, options(epochs=1))[0]) for _ in range(2))
    other = weights(trained(small, options(epochs=1, seed=1))[0])
    assert_same(once, again)
    assert any((once[name] != other[name]).any() for name in once)


@pytest.mark.parametrize("rounds", [0, 1])
def test_an_interrupted_run_goes_on_to_the_same_weights(small: Dataset, tmp_path: Path, rounds: int) -> None:
    given = options(epochs=3, rounds=rounds)
    whole, _ = trained(small, given, tmp_path / "whole")
    _, before = trained(small, given, tmp_path / "parts", stop=2)
    resumed, after = trained(small, given, tmp_path / "parts")
    assert [p.epoch for p in before + after] == [1, 2, 3]
    assert_same(weights(resumed), weights(whole))


def test_a_checkpoint_of_other_options_is_refused(small: Dataset, tmp_path: Path) -> None:
    trained(small, options(epochs=1), tmp_path)
    with pytest.raises(ResultError, match=r"another run|another seed"):
        trained(small, options(epochs=1, seed=5), tmp_path)


@pytest.mark.parametrize("at", [0, 40, 0.5, 0.9])
def test_a_broken_checkpoint_is_named(small: Dataset, tmp_path: Path, at: float) -> None:
    """Also one whose weights have a flipped byte, which torch reads without a word."""
    trained(small, options(epochs=2), tmp_path, stop=1)
    file = tmp_path / "checkpoint.pt"
    content = bytearray(file.read_bytes())
    content[int(at if at >= 1 else at * len(content))] ^= 1
    for damaged in (bytes(content), file.read_bytes()[:-9], b""):
        file.write_bytes(damaged)
        with pytest.raises(ResultError, match=r"checkpoint\.pt: not a whole checkpoint"):
            trained(small, options(epochs=2), tmp_path)


def test_the_hybrid_learns_from_turned_maps(small: Dataset) -> None:
    _, log = trained(small, options(kind="hybrid", epochs=3))
    assert "free" in log[0].parts
    assert sum(log[-1].parts.values()) < sum(log[0].parts.values())


def test_the_joint_network_learns_motions_of_the_recordings(small: Dataset) -> None:
    run, log = trained(
        small, options(kind="joint", epochs=4, sizes=Architecture(**SMALL, accelerations=9, sideways=3))
    )
    assert log[-1].parts["motion"] < log[0].parts["motion"] < 2 * np.log(27)
    assert log[-1].parts["whole"] < log[0].parts["whole"]
    assert log[-1].score.loss < log[0].score.loss
    head = run.finished().head
    assert (np.diff(head.acceleration) > 0).all() and (np.diff(head.sideways) > 0).all()
    assert head.acceleration[0] < 0 < head.acceleration[-1]


def test_a_turned_or_mirrored_map_shows_the_vehicle_that_is_turned_with_it_the_same_road(
    small: Dataset,
) -> None:
    maps = Images(small.roads, CPU).maps[0]
    pose = torch.as_tensor(small.validation.pose[:1])
    in_the_mirror = pose * torch.tensor([1.0, -1.0, -1.0])
    for number, image in enumerate(maps):
        x, y, heading = turned(pose if number < 4 else in_the_mirror, number % 4)[0]
        column, row = (float(v) for v in torch.stack([x, y]) - image.corner)
        here = image.raster[:, round(row), round(column)]
        assert float(here[0]) == 1.0  # drivable
        # The lane's direction there is the vehicle's: cos and sin of the difference.
        along = here[3] * torch.cos(heading) + here[4] * torch.sin(heading)
        assert float(along) == pytest.approx(1.0, abs=0.05)


def test_samples_come_from_the_cache_the_second_time(monkeypatch: pytest.MonkeyPatch, small: Dataset) -> None:
    def fails(*given: object) -> Callable[..., None]:
        raise AssertionError("made again")

    monkeypatch.setattr(dataset_module, "_make", fails)
    again = make_dataset(merge(), SAMPLING)
    np.testing.assert_array_equal(small.train.feature, again.train.feature)
    assert small.digest == again.digest
    with pytest.raises(AssertionError, match="made again"):
        make_dataset(merge(), replace(SAMPLING, copies=2))


def test_simulated_traffic_is_for_training_alone_and_a_share_of_each_epoch(
    monkeypatch: pytest.MonkeyPatch, small: Dataset
) -> None:
    monkeypatch.setattr(dataset_module, "SIMULATED_S", 30.0)
    maps = [example_path("roundabout")]
    mixed = make_dataset(merge(), SAMPLING, maps=maps)
    assert mixed.sites == ("motorway_merge", "roundabout.osm, simulated")
    assert mixed.kinds == ("interaction", "simulated")
    assert mixed.recorded == small.recorded == len(small.train) < len(mixed.train)
    assert set(mixed.train.site[mixed.recorded :]) == {1} and set(mixed.validation.site) == {0}
    assert mixed.digest != small.digest
    monkeypatch.setattr(dataset_module, "_make_simulated", lambda *_: pytest.fail("made again"))
    again = make_dataset(merge(), SAMPLING, maps=maps)
    np.testing.assert_array_equal(mixed.train.feature, again.train.feature)
    run = Trainer(mixed, options(simulated=0.2), device=CPU)
    used = np.concatenate(run._groups(np.random.default_rng(0)))
    nodes, simulated = mixed.train.nodes[used], used >= mixed.recorded
    assert np.array_equal(np.sort(used[~simulated]), np.arange(mixed.recorded))
    assert nodes[simulated].sum() / nodes.sum() == pytest.approx(0.2, abs=0.02)


def test_damaged_samples_in_the_cache_are_made_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, small: Dataset
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    make_dataset(merge(), SAMPLING)
    files = {file: file.read_bytes() for file in cache_folder().glob("samples/motorway_merge-*/*")}
    for content in (b"", b"PK\x03\x04", b"\x93NUMPY"):
        for file in files:
            file.write_bytes(content)
        again = make_dataset(merge(), SAMPLING)
        np.testing.assert_array_equal(small.train.feature, again.train.feature)
        assert len(files) == 2 and all(file.read_bytes() == whole for file, whole in files.items())


def test_tracks_that_are_not_finite_are_named() -> None:
    loaded = load_recording(merge()[0])
    x = loaded.table.vehicles.x.copy()
    x[50] = np.nan
    broken = replace(loaded, table=replace(loaded.table, vehicles=loaded.table.vehicles.with_columns(x=x)))
    with pytest.raises(TrackError, match=r"motorway_merge: track \d+ has no finite x around"):
        part_scenes(broken, "train", split=SAMPLING.split, every_s=0.5)


def test_requests_that_make_no_sense_are_refused(tmp_path: Path) -> None:
    def train(**given: Any) -> None:
        train_command(**{"kind": "graph", "data": [tmp_path], "out": tmp_path / "w.safetensors", **given})

    with pytest.raises(UsageError, match="unknown network; known: graph, hybrid, joint"):
        train(kind="transformer")
    with pytest.raises(UsageError, match="needs --out"):
        train(out=None)
    with pytest.raises(UsageError, match="needs --data"):
        train(data=[])
    with pytest.raises(UsageError, match="no such folder"):
        train(data=[tmp_path / "nowhere"])
    with pytest.raises(UsageError, match=r"--simulated .*nowhere\.osm: no such map"):
        train(simulated=[tmp_path / "nowhere.osm"])
    (tmp_path / "w.safetensors").write_bytes(b"")
    with pytest.raises(ResultError, match="--overwrite"):
        train()
    for place in ("..", ".", str(tmp_path)):
        with pytest.raises(UsageError, match="is a folder; give a file for the weights"):
            train(out=Path(place))
    with pytest.raises(UsageError, match="--epochs needs at least 1"):
        train(out=tmp_path / "other.safetensors", epochs=0)
    with pytest.raises(UsageError, match="train scenes: has no --simulated; only graph, hybrid"):
        train(kind="scenes", out=tmp_path / "other.safetensors", simulated=[example_path("roundabout")])


def test_the_command_goes_on_where_it_was_interrupted_and_its_weights_say_what_they_are(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    short = replace(SAMPLING, copies=0)
    monkeypatch.setattr(dataset_module.SampleOptions, "__call__", None, raising=False)
    monkeypatch.setattr("scex_sumo.learned.training.data.dataset.SampleOptions", lambda **given: short)
    folder = tmp_path / "data"
    folder.mkdir()
    for suffix in (".osm", ".csv"):
        source = example_path("motorway_merge").with_suffix(suffix)
        (folder / source.name).write_bytes(source.read_bytes())
    out = tmp_path / "mine.safetensors"
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))

    def stopped(run: Trainer, tick: object) -> dict[str, float]:
        if run.epoch == 1:
            raise KeyboardInterrupt
        return epoch(run, tick)  # type: ignore[arg-type]

    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        epoch = Trainer._epoch
        patch.setattr(Trainer, "_epoch", stopped)
        train_command("joint", [folder], out, epochs=2)
    assert "has the checkpoint after epoch 1; the same command goes on" in capsys.readouterr().err
    train_command("joint", [folder], out, epochs=2)
    assert "goes on after epoch 1" in capsys.readouterr().out
    meta = load_weights(out, "joint").meta
    assert meta["sites"] == ["motorway_merge"]
    assert meta["command"] == "scex-sumo train joint --data data --seed 0 --epochs 2"
    assert meta["validation"]["motorway_merge"]["fde_m"] > 0
    # no checkpoints left
    assert sorted(p.name for p in tmp_path.iterdir()) == ["cache", "data", "mine.safetensors"]


def test_names_that_are_not_there_are_refused(tmp_path: Path) -> None:
    for suffix in (".osm", ".csv"):
        source = example_path("motorway_merge").with_suffix(suffix)
        (tmp_path / source.name).write_bytes(source.read_bytes())
    for option, what in (("leave_out", "site or recording"), ("validation", "recording")):
        with pytest.raises(UsageError, match=f"nowhere: no such {what}; known: motorway_merge"):
            train_command("graph", [tmp_path], tmp_path / "w.safetensors", **{option: ["nowhere"]})
