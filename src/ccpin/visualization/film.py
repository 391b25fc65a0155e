"""Where a picture goes: a page as it is, or its frames as a headless Chromium shows them, as MP4, GIF or PNG."""

from __future__ import annotations

import importlib.util
import io
import shutil
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ccpin.arrays import listener, positive, whole
from ccpin.errors import CcpinError, InvalidInputError
from ccpin.files import writable_target, write_atomically, write_text
from ccpin.visualization.browser import BrowserPage

PAGES = (".html", ".htm")
"""The endings of self-contained web pages."""
FILMS = (".mp4", ".gif")
"""The endings of films."""
STILLS = (".png",)
"""The endings of pictures."""
# Width and height in pixels, where none is asked for.
SIZES = {".mp4": (1280, 720), ".gif": (800, 450), ".png": (1280, 720)}
LARGEST = 8192  # pixels: a longer edge is refused
GIF_FPS = 50.0
"""The fastest that browsers play a GIF, whose frames last whole hundredths of a second."""
QUALITY = 8
"""Of the H.264 encoding, of 10."""


class Shot:
    """What is to be written where, checked before anything is computed.

    Args:
        path: The file.
        endings: Those it may have.
        size: Width and height in pixels, or ``None`` for the ending's own.
        fps: Frames per second of a film.

    Raises:
        InvalidInputError: The path cannot be written or has another ending, or the size or `fps` is none there is.
        CcpinError: The encoder of a film is not installed.
    """

    def __init__(
        self, path: str | Path, endings: tuple[str, ...], size: tuple[int, int] | None, fps: float = 30.0
    ) -> None:
        self.target = writable_target(path)
        self.ending = self.target.suffix.lower()
        if self.ending not in endings:
            known = f"{', '.join(endings[:-1])} or {endings[-1]}"
            raise InvalidInputError(f"'{self.target}': what is drawn is written as {known}")
        self.size = _checked_size(size, SIZES.get(self.ending, SIZES[".mp4"]))
        self.fps = positive(fps, "fps")
        if self.ending == ".gif" and self.fps > GIF_FPS:
            raise InvalidInputError(
                f"fps = {self.fps:g}: a GIF plays at most {GIF_FPS:g} frames a second; .mp4 plays more"
            )
        if self.ending == ".mp4" and importlib.util.find_spec("imageio_ffmpeg") is None:
            raise CcpinError("an .mp4 is encoded by imageio-ffmpeg: pip install 'ccpin[video]'; .html needs nothing")


def write(shot: Shot, page: str, frames: int, progress: Callable[[int, int], None] | None = None) -> Path:
    """Write a page, or what its `frames` frames show; return where to.

    Raises:
        InvalidInputError: The file cannot be written.
        CcpinError: choreographer or a browser is missing, or the encoder fails.
    """
    told = listener(progress)
    if shot.ending in PAGES:
        write_text(shot.target, page)
        return shot.target
    encode = {".mp4": _mp4, ".gif": _gif, ".png": _png}[shot.ending]
    with tempfile.TemporaryDirectory(prefix="ccpin-film-") as folder:
        source = Path(folder, "page.html")
        source.write_text(page, encoding="utf-8")
        with BrowserPage(source.as_uri(), *shot.size) as opened:
            film = Path(folder, f"film{shot.ending}")
            encode(_shots(opened, frames, told), film, shot)
        with film.open("rb") as done:
            write_atomically(shot.target, "wb", lambda file: shutil.copyfileobj(done, file))
    return shot.target


def _shots(page: BrowserPage, frames: int, told: Callable[[int, int], object]) -> Iterator[Any]:
    """Each frame as the browser shows it, as an RGB picture of Pillow's."""
    from PIL import Image

    for frame in range(frames):
        page.evaluate(f"film({frame})")
        yield Image.open(io.BytesIO(page.picture())).convert("RGB")
        told(frame + 1, frames)


def _mp4(pictures: Iterator[Any], path: Path, shot: Shot) -> None:
    """H.264, which every browser and slide program plays."""
    import imageio_ffmpeg

    writer = imageio_ffmpeg.write_frames(str(path), shot.size, fps=shot.fps, quality=QUALITY, macro_block_size=2)
    writer.send(None)
    try:
        for picture in pictures:
            writer.send(picture.tobytes())
    except OSError as error:
        raise CcpinError(f"the encoder of '{shot.target}' failed: {error}") from None
    finally:
        writer.close()


def _gif(pictures: Iterator[Any], path: Path, shot: Shot) -> None:
    """Each frame in its own palette; it plays over and over."""
    from PIL import Image

    reduced = [picture.quantize(256, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE) for picture in pictures]
    ends = 10 * np.round(100 * np.arange(len(reduced) + 1) / shot.fps).astype(int)
    reduced[0].save(path, save_all=True, append_images=reduced[1:], duration=np.diff(ends).tolist(), loop=0)


def _png(pictures: Iterator[Any], path: Path, shot: Shot) -> None:
    next(pictures).save(path)


def _checked_size(size: object, default: tuple[int, int]) -> tuple[int, int]:
    if size is None:
        return default
    if not isinstance(size, tuple | list) or len(size) != 2:
        raise InvalidInputError(f"size = {size!r:.80} must be a width and a height in pixels")
    width, height = (whole(side, "size", 16) for side in size)
    if width % 2 or height % 2 or max(width, height) > LARGEST:
        raise InvalidInputError(f"size = {width} × {height}: both must be even, at most {LARGEST}")
    return width, height
