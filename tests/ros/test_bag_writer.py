import pytest

import ros_bags as bags
from graspcast.errors import InputError
from graspcast.ros.bag_reader import MCAP, ROS1, SQLITE
from graspcast.ros.bag_writer import BagWriter, check_output, written_kind

pytest.importorskip("rosbags", reason="pip install 'graspcast[rosbag]'")

TEXT = "std_msgs/msg/String"


def test_the_kind_that_is_written():
    assert written_kind("a.mcap", SQLITE) == MCAP and written_kind("a", MCAP) == MCAP
    assert written_kind("a.bag", ROS1) == ROS1
    for out, read in (("a.mcap", ROS1), ("a.bag", MCAP)):
        with pytest.raises(InputError, match=r"differ.*rosbags-convert"):
            written_kind(out, read)
    with pytest.raises(InputError, match=r"ends in \.bag"):
        written_kind("a", ROS1)


def put(out, kind, *texts):
    with BagWriter.open(out, kind) as writer:
        topic = writer.add_topic("/text", TEXT)
        for k, text in enumerate(texts):
            writer.write_message(topic, k + 1, writer.types.types[TEXT](data=text))


@pytest.mark.parametrize(
    ("name", "kind"),
    [("a.bag", ROS1), ("a.db3", SQLITE), ("a", SQLITE), ("b.mcap", MCAP), ("b", MCAP)],
)
def test_a_bag_is_there_when_it_is_whole(tmp_path, name, kind):
    put(tmp_path / "new" / name, kind, "x", "y")
    read = bags.read_bag(tmp_path / "new" / name)
    assert [(topic, time, m.data) for topic, time, m in read] == [
        ("/text", 1, "x"),
        ("/text", 2, "y"),
    ]
    assert [p.name for p in (tmp_path / "new").iterdir()] == [name]


@pytest.mark.parametrize(("name", "kind"), [("a.bag", ROS1), ("a.db3", SQLITE), ("b", MCAP)])
def test_after_an_error_what_was_there_is_there(tmp_path, name, kind):
    if "." in name:
        put(tmp_path / name, kind, "old")
    before = {p.name for p in tmp_path.iterdir()}
    with pytest.raises(ZeroDivisionError), BagWriter.open(tmp_path / name, kind) as writer:
        writer.add_topic("/text", TEXT)
        raise ZeroDivisionError
    assert {p.name for p in tmp_path.iterdir()} == before
    if before:
        assert [m.data for _, _, m in bags.read_bag(tmp_path / name)] == ["old"]


def test_a_full_disk_is_an_error_and_leaves_nothing(tmp_path, monkeypatch):
    import sqlite3

    for error, said in [
        (sqlite3.OperationalError("database or disk is full"), "disk is full"),
        (OSError(28, "No space left on device"), "No space left"),
    ]:
        with (
            pytest.raises(InputError, match=rf"a\.db3: could not be written \({said}|disk is full"),
            BagWriter.open(tmp_path / "a.db3", SQLITE),
        ):
            raise error
    assert list(tmp_path.iterdir()) == []


def test_places_that_cannot_be_written_are_refused(tmp_path):
    (tmp_path / "file").write_text("")
    (tmp_path / "in").mkdir()
    for out in (tmp_path / "file" / "a.bag", tmp_path / "in", tmp_path / "in" / "b.mcap"):
        with pytest.raises(InputError):
            check_output(out, tmp_path / "in")
    check_output(tmp_path / "new" / "a.bag", tmp_path / "in")
