"""Videos have every frame, at true speed."""

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from drpbench.recording import RecordingError, motion, offscreen
from drpbench.recording.camera import camera
from drpbench.recording.video import Shot, film, film_grid, suffix, write_video

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


def test_a_shot_shows_an_episode_at_its_speed():
    assert Shot().instants(13, 1 / 60) == [0, 2, 4, 6, 8, 10, 12]
    assert Shot(speed=2.0).instants(13, 1 / 60) == [0, 4, 8, 12]
    assert Shot(speed=0.25).instants(3, 1 / 60) == [0, 0, 1, 2, 2]
    assert Shot(fps=60.0).instants(1001, 1 / 60) == list(range(1001))


@pytest.mark.parametrize(
    ("shown", "named"),
    [
        ({"size": (641, 480)}, "641x480 pixels: expected multiples of 8 from 64"),
        ({"size": (640, 16)}, "640x16"),
        ({"fps": 0.0}, "0 frames a second: expected 1 to 60"),
        ({"speed": 0.0}, "0 times the true speed: expected"),
        ({"speed": float("nan")}, "nan times the true speed"),
        ({"camera": "kitchen"}, "no camera 'kitchen'; there are: corner,.*contact, or AZIMUTH"),
        ({"camera": "1,2"}, "no camera '1,2'"),
        ({"camera": "nan,0,1"}, "no camera"),
    ],
)
def test_what_no_shot_can_show_is_one_line(shown, named):
    with pytest.raises(RecordingError, match=named) as error:
        Shot(**shown)
    assert "\n" not in str(error.value)


def test_the_camera_goes_to_the_contact(rolled):
    b = next(b for b, row in enumerate(rolled.rows) if row.collided)
    moved = motion(rolled.episodes[b])
    first = int(np.flatnonzero(moved.touching)[0])
    found = camera("contact", moved)
    np.testing.assert_allclose(found.at, moved.contact_point[first], atol=1e-6)
    assert found.distance < camera("corner").distance / 2


@pytest.mark.parametrize("kind", [".mp4", ".webp"])
def test_an_episode_becomes_thirty_frames_a_second(rolled, tmp_path, kind):
    if kind == ".mp4":
        pytest.importorskip("imageio_ffmpeg")
    told = []
    path = tmp_path / f"one{kind}"
    film(path, short(rolled.episodes[0], 13), Shot((160, 120)), lambda *done: told.append(done))
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
    film_grid(path, [short(rolled.episodes[n], first + 9) for n in order], Shot((320, 240), 15.0))
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
