"""Video of a child: MP4 with PyAV, or GIF."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from PIL import Image

from scex_sumo.errors import UsageError
from scex_sumo.exporters.frames import Film
from scex_sumo.exporters.request import Request
from scex_sumo.files import replacing
from scex_sumo.scene import LOGGED_HISTORY
from scex_sumo.views.children import colors_of, event_of

_MP4_SIZE, _MP4_RATE = (1280, 720), 30  # pixels; pictures a second, in real time
_GIF_SIZE, _GIF_RATE, _GIF_COLORS = (800, 450), 10, 64
_FRAME_RATE = 10  # of a child
_STILL_S = 1.0  # the last picture stays


def write_mp4(request: Request) -> list[Path]:
    """Each child as an MP4 file (H.264) in real time; several go into a folder.

    Raises:
        UsageError: PyAV is not installed.
    """
    if importlib.util.find_spec("av") is None:
        raise UsageError("--to mp4 needs PyAV: pip install 'scex-sumo[video]'; --to gif needs nothing")
    return _write(request, "mp4", _encode_mp4)


def write_gif(request: Request) -> list[Path]:
    """Each child as an animated GIF in real time; several go into a folder."""
    return _write(request, "gif", _encode_gif)


def _write(request: Request, ending: str, encode: Callable[[Path, Request, int], None]) -> list[Path]:
    files = []
    for child in request.children:
        name = f"{request.file_stem(child)}.{ending}"
        path = (request.out or Path(name)) if len(request.children) == 1 else request.folder / name
        if path.is_dir():
            path /= name
        path.parent.mkdir(parents=True, exist_ok=True)
        with replacing(path) as unfinished:
            encode(unfinished, request, child)
        files.append(path)
    return files


def _encode_mp4(path: Path, request: Request, child: int) -> None:
    import av

    with av.open(str(path), "w", format="mp4", options={"movflags": "faststart"}) as container:
        stream = container.add_stream("libx264", rate=_MP4_RATE)
        stream.width, stream.height = _MP4_SIZE
        stream.pix_fmt = "yuv420p"
        stream.options = {"crf": "22", "preset": "veryfast"}
        for picture in _pictures(request, child, _MP4_SIZE, _MP4_RATE):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(np.asarray(picture))))
        container.mux(stream.encode())


def _encode_gif(path: Path, request: Request, child: int) -> None:
    pictures = list(_pictures(request, child, _GIF_SIZE, _GIF_RATE))
    colors = pictures[-1].quantize(_GIF_COLORS)
    first, *rest = (picture.quantize(palette=colors, dither=Image.Dither.NONE) for picture in pictures)
    first.save(path, "GIF", save_all=True, append_images=rest, duration=1000 // _GIF_RATE, loop=0)


def _pictures(request: Request, child: int, size: tuple[int, int], rate: int) -> Iterator[Image.Image]:
    """A child from its first frame to its last, which stays for a while."""
    run, scene = request.run, request.scene
    tracks, words = event_of(run, child, critical=request.critical, encounter=request.encounter)
    film = Film(
        scene=scene,
        states=run.states(child),
        models=run.models_of(child),
        colors=colors_of(run),
        title=" · ".join(part for part in (request.name, f"child {child}", words) if part),
        pair=[scene.track_ids.tolist().index(track) for track in tracks],
        net=run.net.path,
        size=size,
    )
    last = LOGGED_HISTORY - 1 + int(run.info["steps"])
    for frame in np.arange(0, last + 1e-9, _FRAME_RATE / rate):
        picture = film.picture(float(frame))
        yield picture
    for _ in range(round(_STILL_S * rate)):
        yield picture
