"""The file as any reader sees it: whole, at true times, with the numbers of the trace."""

from collections import defaultdict

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from scipy.spatial.transform import Rotation

from drpbench.recording import RecordingError, motion
from drpbench.recording.episode import nanoseconds
from drpbench.recording.recorder import Recorder
from drpbench.robot import PANDA


def read(path):
    """(log time, message) by topic, and the file's metadata."""
    found = defaultdict(list)
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for _, channel, message, content in reader.iter_decoded_messages():
            found[channel.topic].append((message.log_time, content))
        about = {record.name: dict(record.metadata) for record in reader.iter_metadata()}
    return found, about


@pytest.fixture(scope="module")
def files(rolled, header, tmp_path_factory):
    """Those that a run's hook writes of a whole batch."""
    folder = tmp_path_factory.mktemp("mcap")
    with Recorder(folder) as recorder:
        recorder.watch(header, "FDO", rolled.ids, rolled.trace)
    return [read(folder / f"FDO-{id:05d}.mcap") for id in rolled.ids]


def test_every_step_is_there_at_its_time(files):
    every = [nanoseconds(k) for k in range(1001)]
    for found, about in files:
        for topic in ("/joint_states", "/clearance"):
            assert [time for time, _ in found[topic]] == every
        own = [t for t, m in found["/tf"] if m.transforms[0].child_frame_id == "link0"]
        assert own == every
        assert [time for time, _ in found["/points/arm"]] == every[::6]
        assert about["drpbench"]["policy"] == "straight+dcp-rmp"


def test_stamps_are_the_log_times(files):
    for topic in ("/joint_states", "/points/boxes", "/log"):
        for time, message in files[0][0][topic]:
            assert message.timestamp.seconds * 10**9 + message.timestamp.nanos == time


def test_joints_and_clearance_are_the_traces(files, rolled):
    for b, (found, _) in enumerate(files):
        joints = np.array([[j.position for j in m.joints] for _, m in found["/joint_states"]])
        speeds = np.array([[j.velocity for j in m.joints] for _, m in found["/joint_states"]])
        np.testing.assert_array_equal(joints[0], rolled.trace.start[b])
        np.testing.assert_array_equal(joints[1:], rolled.trace.joint_position[:, b])
        np.testing.assert_array_equal(speeds[1:], rolled.trace.joint_velocity[:, b])
        clearance = np.array([m.value for _, m in found["/clearance"]])
        np.testing.assert_allclose(clearance[1:], rolled.trace.clearance[:, b], atol=1e-5)


def test_boxes_are_where_the_trace_has_them(files, rolled):
    for b, (found, _) in enumerate(files):
        own = [m for _, m in found["/tf"] if m.transforms[0].child_frame_id == "link0"]
        frames = [t.child_frame_id for t in own[0].transforms]
        assert frames == [*PANDA.frame_names, "box0", "box1", "box2"]
        for k in (1, 400, 1000):
            for box, t in enumerate(own[k].transforms[9:]):
                place = rolled.trace.mover_position[k - 1, b, box]
                np.testing.assert_array_equal(
                    [t.translation.x, t.translation.y, t.translation.z], place
                )
                turn = Rotation.from_matrix(rolled.trace.mover_rotation[k - 1, b, box]).as_quat()
                found_turn = [t.rotation.x, t.rotation.y, t.rotation.z, t.rotation.w]
                assert abs(float(turn @ np.array(found_turn))) > 1 - 1e-5
        shapes = [m for _, m in found["/obstacles"]][0].entities
        edges = [[s.size.x, s.size.y, s.size.z] for e in shapes for s in e.cubes]
        np.testing.assert_allclose(edges, 2 * rolled.trace.mover_half_size[0, b], rtol=1e-6)
        assert {e.frame_id for e in shapes} == {"box0", "box1", "box2"}


def test_boxes_vanish_when_the_task_removes_them(files, rolled):
    end = 1000 - 300  # FDO
    for found, _ in files:
        time, last = found["/obstacles"][-1]
        assert time == nanoseconds(end + 1) and not last.entities
        assert {d.id for d in last.deletions} == {"box0", "box1", "box2"}


def test_the_static_scene_has_every_primitive(files, rolled):
    for (found, _), id in zip(files, rolled.ids, strict=True):
        (_, message), there = found["/scene"][0], rolled.problems.obstacles.mask[id]
        solids = [s for e in message.entities for s in (*e.cubes, *e.cylinders, *e.spheres)]
        centers = np.array(
            [[s.pose.position.x, s.pose.position.y, s.pose.position.z] for s in solids]
        )
        np.testing.assert_allclose(
            centers, rolled.problems.obstacles.position[id][there], rtol=1e-6
        )
        sizes = np.array([[s.size.x, s.size.y, s.size.z] for s in solids])
        np.testing.assert_allclose(
            sizes, 2 * rolled.problems.obstacles.half_size[id][there], rtol=1e-6
        )


def test_a_contact_is_red_marked_and_logged_for_as_long_as_it_lasts(files, rolled):
    collided = 0
    for (found, _), episode, row in zip(files, rolled.episodes, rolled.rows, strict=True):
        touching = motion(episode).touching
        marks = [time for time, _ in found["/contact"]]
        assert marks == [nanoseconds(k) for k in np.flatnonzero(touching).tolist()]
        shouts = [(time, m.message) for time, m in found["/log"] if m.level == 4]
        assert bool(shouts) == row.collided
        if row.collided:
            collided += 1
            assert shouts[0][0] == nanoseconds(row.first_collision_step + 1)
            assert row.first_collision_link in shouts[0][1]
            arm = dict(found["/arm"])[nanoseconds(row.first_collision_step + 1)]
            frame = row.first_collision_link.replace("left_finger", "hand")
            frame = frame.replace("right_finger", "hand")
            reds = {
                e.id
                for e in arm.entities
                for s in (*e.cubes, *e.cylinders, *e.spheres)
                if s.color.r > 0.8 and s.color.g < 0.2
            }
            assert reds == {frame}
    assert collided


def test_points_lie_on_the_boxes(files, rolled):
    found, _ = files[0]
    for k in (0, 300):
        _, message = found["/points/boxes"][k // 6]
        points = np.frombuffer(message.data, "<f4").reshape(-1, message.point_stride // 4)
        movers = rolled.episodes[0].boxes
        gaps = []
        for position, rotation, half in zip(
            movers.position[k], movers.rotation[k], movers.half_size[k], strict=True
        ):
            local = (points - position) @ rotation
            gaps.append(np.abs((np.abs(local) / half).max(axis=1) - 1.0))
        assert len(points) > 500 and np.min(gaps, axis=0).max() < 1e-4


def test_dcp_rmp_shows_what_it_gives_way_to(files, rolled):
    """Its line leads from the arm to a point on a moving box, and only while the goal is
    modified."""
    shown = 0
    for (found, _), episode in zip(files, rolled.episodes, strict=True):
        movers = episode.boxes
        for time, message in found["/dcp_rmp/closest"]:
            for entity in message.entities:
                k, shown = round(time * 60 / 1e9), shown + 1
                point = entity.lines[0].points[1]
                local = np.einsum(
                    "mi,mij->mj",
                    np.array([point.x, point.y, point.z]) - movers.position[k],
                    movers.rotation[k],
                )
                off = np.abs((np.abs(local) / movers.half_size[k]).max(axis=1) - 1.0)
                assert off[movers.active[k]].min() < 1e-3
    assert shown > 10


def test_the_modified_goal_is_shown_while_it_is_one(files):
    """Its arm appears and vanishes in turn, and each of its poses lies in between."""
    for found, _ in files:
        turns = found["/dcp_rmp/goal"]
        assert [bool(m.entities) for _, m in turns] == [n % 2 == 0 for n in range(len(turns))]
        poses = [t for t, m in found["/tf"] if m.transforms[0].child_frame_id == "modified/link0"]
        ends = [time for time, _ in turns] + [nanoseconds(1000) + 1] * (len(turns) % 2)
        spans = list(zip(ends[::2], ends[1::2], strict=True))
        assert poses and all(any(a <= time < b for a, b in spans) for time in poses)


def test_a_crash_in_the_middle_leaves_the_old_file_or_none(rolled, header, tmp_path, monkeypatch):
    from drpbench.recording.container import _Records

    recorder = Recorder(tmp_path)
    path = recorder.write(header, rolled.episodes[0])
    before = path.read_bytes()

    written = []
    whole = _Records.write_chunk

    def broken(records, out, *arguments):
        if written:
            raise RuntimeError("power cut")
        written.append(whole(records, out, *arguments))
        return written[0]

    monkeypatch.setattr(_Records, "write_chunk", broken)
    with pytest.raises(RuntimeError, match="power cut"):
        recorder.write(header, rolled.episodes[0])
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


def test_only_those_asked_for_are_written(rolled, header, tmp_path):
    with Recorder(tmp_path, {"FDO": {17}}) as recorder:
        recorder.watch(header, "FDO", rolled.ids, rolled.trace)
    assert [path.name for path in tmp_path.iterdir()] == ["FDO-00017.mcap"]


def test_a_folder_that_cannot_be_written_is_one_line(rolled, header, tmp_path):
    (tmp_path / "file").touch()
    with (
        pytest.raises(RecordingError, match="cannot be written") as error,
        Recorder(tmp_path / "file") as recorder,
    ):
        recorder.watch(header, "FDO", rolled.ids, rolled.trace)
    assert len(str(error.value).splitlines()) == 1
