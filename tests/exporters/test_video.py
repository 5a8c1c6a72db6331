"""A future as a video: in real time, vehicles in the colours of their models, a critical pair ringed."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from scex_sumo.base.errors import UsageError
from scex_sumo.exporters.command import export_command
from scex_sumo.results.run import Run
from scex_sumo.views.futures import colors_of

RING = (208, 40, 40)


def pixels(picture: Image.Image, color: tuple[int, int, int], within: int) -> int:
    """How many pixels of a picture have a colour, but for so much in each channel."""
    apart = np.abs(np.asarray(picture.convert("RGB")).astype(int) - np.array(color))
    return int((apart.max(axis=2) <= within).sum())


def test_a_gif_shows_every_frame_for_a_tenth_of_a_second(run: Run, tmp_path: Path) -> None:
    export_command(run.folder, future=2, to="gif", out=tmp_path / "two.gif")
    with Image.open(tmp_path / "two.gif") as film:
        assert film.size == (800, 450)
        shown = []
        for frame in range(film.n_frames):  # type: ignore[attr-defined]
            film.seek(frame)
            shown.append(film.info["duration"])
        # 4 s, the last picture for 1 s more; equal pictures are one that stays.
        assert sum(shown) == 5000 and len(shown) >= 40
    assert (tmp_path / "two.gif").stat().st_size < 500_000


def test_an_mp4_plays_in_real_time_and_rings_the_critical_pair(run: Run, tmp_path: Path) -> None:
    av = pytest.importorskip("av")
    met = run.encounters.slice(0, 1).to_pylist()[0]
    pair = f"{met['track_id']},{met['other_id']}"
    export_command(run.folder, encounter=pair, to="mp4", out=tmp_path / "ringed.mp4")
    with av.open(tmp_path / "ringed.mp4") as film:
        stream = film.streams.video[0]
        assert (stream.width, stream.height, stream.average_rate) == (1280, 720, 30)
        pictures = list(film.decode(stream))
        assert len(pictures) == 39 * 3 + 1 + 30
        last = pictures[-1].to_image()
    assert pixels(last, RING, 24) > 300  # no model's colour is near it
    for model in set(run.models_of(met["future"])):
        assert pixels(last, colors_of(run)[model], 24) > 200


def test_without_the_encoder_the_remedy_is_said(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(UsageError, match=r"pip install '\.\[video\]'"):
        export_command(run.folder, future=0, to="mp4")
