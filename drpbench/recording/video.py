"""Videos of episodes: MP4 where an encoder is installed, else animated WebP."""

import importlib.util
import math
import os
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .camera import CONTACT, camera
from .episode import Recording, RecordingError
from .motion import Motion, motion
from .stage import Stage


@dataclass(frozen=True)
class Shot:
    """How a video shows an episode.

    Raises RecordingError where a value is none that can be drawn.
    """

    size: tuple[int, int] = (960, 720)
    """[pixels] width and height."""
    fps: float = 30.0
    """Frames a second."""
    speed: float = 1.0
    """Seconds of an episode that a second of the video shows."""
    camera: str = "corner"
    """See `drpbench.recording.camera`."""

    def __post_init__(self):
        least, most = SIZES
        if not all(least <= n <= most and n % 8 == 0 for n in self.size):
            raise RecordingError(
                f"a video of {self.size[0]}x{self.size[1]} pixels: expected multiples of 8 from "
                f"{least} to {most}"
            )
        if not 1 <= self.fps <= 60:
            raise RecordingError(f"{self.fps:g} frames a second: expected 1 to 60")
        if not 0.05 <= self.speed <= 20:
            raise RecordingError(f"{self.speed:g} times the true speed: expected 0.05 to 20")
        if self.camera != CONTACT:
            camera(self.camera)

    def instants(self, count: int, period: float) -> list[int]:
        """Which of `count` instants, `period` [s] apart, the frames show, the first to the last."""
        stride = self.speed / (self.fps * period)
        return [round(k * stride) for k in range(int((count - 1) / stride + 1e-9) + 1)]


SIZES = (64, 3840)  # [pixels] least and most
GRID = Shot((1280, 960), 15.0)

_FRAME = 4  # [pixels] width of a tile's coloured frame
_COLLIDED, _AT_GOAL, _NEITHER = (226, 32, 36), (46, 160, 67), (255, 255, 255)


def suffix() -> str:
    """`.mp4` where imageio-ffmpeg (the extra `video`) is installed, else `.webp`."""
    return ".mp4" if importlib.util.find_spec("imageio_ffmpeg") else ".webp"


def film(
    path: Path,
    episode: Recording,
    shot: Shot = Shot(),
    advanced: Callable[[int, int], None] = lambda done, of: None,
) -> None:
    """Writes a video of one episode; the path's suffix, .mp4 or .webp, says of which kind. It is
    framed in red while the arm touches an obstacle.

    `advanced` is told of frames done. Raises RecordingError where nothing can be drawn or written.
    """
    moved, stage = motion(episode), Stage(*shot.size, episode.world.robot)
    stage.aim(camera(shot.camera, moved))
    instants = shot.instants(episode.instants, episode.world.episode.period)

    def frames() -> Iterator[np.ndarray]:
        for done, instant in enumerate(instants):
            picture = stage.draw(episode, moved, instant)
            yield _framed(picture, _COLLIDED) if moved.touching[instant] else picture
            advanced(done + 1, len(instants))

    try:
        write_video(path, frames(), shot.size, shot.fps)
    finally:
        stage.close()


def film_grid(
    path: Path,
    episodes: Sequence[Recording],
    shot: Shot = GRID,
    advanced: Callable[[int, int], None] = lambda done, of: None,
) -> None:
    """Writes one video of many episodes of one arm side by side, row by row. Each is framed: green
    while it is at its goal, red from its first collision on. The size is the most it may have."""
    columns = math.ceil(math.sqrt(len(episodes)))
    rows = math.ceil(len(episodes) / columns)
    width, height = (n // columns // 8 * 8 for n in shot.size)
    robot = episodes[0].world.robot
    stage, moved = Stage(width, height, robot), [motion(episode) for episode in episodes]
    frames_of = [_frame_colors(each) for each in moved]
    views = [camera(shot.camera, each) for each in moved]
    longest = max(episode.instants for episode in episodes)
    instants = shot.instants(longest, episodes[0].world.episode.period)

    def frames() -> Iterator[np.ndarray]:
        for done, instant in enumerate(instants):
            sheet = np.full((rows * height, columns * width, 3), 255, np.uint8)
            for place, (episode, seen, colors) in enumerate(
                zip(episodes, moved, frames_of, strict=True)
            ):
                now = min(instant, episode.instants - 1)
                row, column = divmod(place, columns)
                tile = sheet[row * height :, column * width :][:height, :width]
                stage.aim(views[place])
                tile[:] = _framed(stage.draw(episode, seen, now), colors[now])
            yield sheet
            advanced(done + 1, len(instants))

    try:
        write_video(path, frames(), (columns * width, rows * height), shot.fps)
    finally:
        stage.close()


def _framed(picture: np.ndarray, color: Sequence[int] | np.ndarray) -> np.ndarray:
    framed, inner = np.empty_like(picture), slice(_FRAME, -_FRAME)
    framed[:] = color
    framed[inner, inner] = picture[inner, inner]
    return framed


def _frame_colors(motion: Motion) -> np.ndarray:
    """(N, 3) uint8."""
    collided = np.logical_or.accumulate(motion.touching)[:, None]
    good = np.where(motion.at_goal[:, None], _AT_GOAL, _NEITHER)
    return np.where(collided, _COLLIDED, good).astype(np.uint8)


def write_video(
    path: Path, frames: Iterable[np.ndarray], size: tuple[int, int], rate: float
) -> None:
    """Writes frames (height, width, 3) uint8, so many a second, whole or not at all.

    `size` is width and height in pixels. A video that is there is replaced.
    """
    temporary = path.with_name(f".{path.stem}.{os.getpid()}.tmp{path.suffix}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            {".mp4": _mp4, ".webp": _webp}[path.suffix](temporary, frames, size, rate)
            os.replace(temporary, path)
        finally:
            temporary.unlink(missing_ok=True)
    except OSError as error:
        reason = (error.strerror or " ".join(str(error).split())[-200:]).lower()
        raise RecordingError(f"{path}: cannot be written: {reason}") from None


def _mp4(path: Path, frames: Iterable[np.ndarray], size: tuple[int, int], rate: float) -> None:
    import imageio_ffmpeg

    # yuv420p is what every browser plays.
    writer = imageio_ffmpeg.write_frames(
        str(path),
        size,
        fps=rate,
        codec="libx264",
        pix_fmt_out="yuv420p",
        output_params=["-crf", "23", "-preset", "veryfast", "-threads", "1"],
        macro_block_size=8,
        ffmpeg_log_level="error",
    )
    with warnings.catch_warnings():
        # JAX warns of every fork; this one becomes ffmpeg at once.
        warnings.filterwarnings("ignore", "os.fork", RuntimeWarning)
        writer.send(None)
    try:
        for frame in frames:
            writer.send(np.ascontiguousarray(frame))
    finally:
        writer.close()


def _webp(path: Path, frames: Iterable[np.ndarray], size: tuple[int, int], rate: float) -> None:
    from PIL import Image

    pictures = (Image.fromarray(frame) for frame in frames)
    first = next(pictures)
    first.save(
        path,
        save_all=True,
        append_images=pictures,
        duration=round(1000 / rate),
        loop=0,
        quality=70,
        method=2,
    )
