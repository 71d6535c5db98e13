"""Videos have every frame, at true speed."""

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from drpbench.recording import RecordingError, offscreen
from drpbench.recording.video import film, film_grid, suffix, write_video

try:
    offscreen.choose_platform()
except RecordingError as error:
    pytest.skip(str(error), allow_module_level=True)

pytestmark = pytest.mark.filterwarnings("ignore:os.fork:RuntimeWarning")  # the reader's, not ours


def short(episode, instants):
    """The episode's first instants."""
    boxes = replace(episode.boxes, **{f: v[:instants] for f, v in vars(episode.boxes).items()})
    return replace(
        episode,
        joint_position=episode.joint_position[:instants],
        joint_velocity=episode.joint_velocity[:instants],
        boxes=boxes,
        sphere=None if episode.sphere is None else episode.sphere[: instants - 1],
    )


def frames_of(path):
    if path.suffix == ".webp":
        with Image.open(path) as picture:
            found = []
            for n in range(picture.n_frames):
                picture.seek(n)
                found.append(np.asarray(picture.convert("RGB")))
            return found, 1000 / picture.info["duration"]
    imageio_ffmpeg = pytest.importorskip("imageio_ffmpeg")
    reader = imageio_ffmpeg.read_frames(str(path))
    about = next(reader)
    width, height = about["size"]
    found = [np.frombuffer(f, np.uint8).reshape(height, width, 3) for f in reader]
    return found, about["fps"]


@pytest.mark.parametrize("kind", [".mp4", ".webp"])
def test_an_episode_becomes_thirty_frames_a_second(rolled, tmp_path, kind):
    if kind == ".mp4":
        pytest.importorskip("imageio_ffmpeg")
    told = []
    path = tmp_path / f"one{kind}"
    film(path, short(rolled.episodes[0], 13), (160, 120), lambda *done: told.append(done))
    frames, rate = frames_of(path)
    assert rate == pytest.approx(30, rel=0.02)
    assert len(frames) == 7 and frames[0].shape == (120, 160, 3)
    assert told[-1] == (7, 7)
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


def test_a_grid_frames_each_episode_by_how_it_goes(rolled, tmp_path):
    """Three in two columns: the one that collided has a red frame from then on, the empty place is
    white."""
    b = next(b for b, row in enumerate(rolled.rows) if row.collided)
    first = rolled.rows[b].first_collision_step + 1
    order = [b, *(other for other in range(3) if other != b)]
    path = tmp_path / f"grid{suffix()}"
    film_grid(path, [short(rolled.episodes[n], first + 9) for n in order], (320, 240))
    frames, rate = frames_of(path)
    assert rate == pytest.approx(15, rel=0.02) and frames[0].shape == (240, 320, 3)
    edge = frames[-1][20:100, 1].astype(int)
    assert (edge[:, 0] - edge[:, 1] > 100).all()
    assert (frames[0][20:100, 1] > 230).all() and (frames[-1][140:, 180:] > 240).all()


def test_what_cannot_be_written_is_one_line_and_leaves_nothing(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(RecordingError, match="cannot be written"):
        write_video(tmp_path / "file" / "x.webp", iter([np.zeros((8, 8, 3), np.uint8)]), (8, 8), 30)

    def broken():
        yield np.zeros((16, 16, 3), np.uint8)
        raise RuntimeError("stop")

    with pytest.raises(RuntimeError, match="stop"):
        write_video(tmp_path / "x.webp", broken(), (16, 16), 30)
    assert [p.name for p in tmp_path.iterdir()] == ["file"]
