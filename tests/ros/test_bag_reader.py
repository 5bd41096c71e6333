import pytest

import ros_bags as bags
import ros_messages as ros
from graspcast.errors import FormatError, InputError, UnknownNameError
from graspcast.ros.bag_reader import MCAP, ROS1, SQLITE, BagReader, kind_of
from graspcast.ros.definitions import DETECTIONS

pytest.importorskip("rosbags", reason="pip install 'graspcast[rosbag]'")

NAMES = {"bag": "5", "db3": "mug", "mcap": "mug"}
KINDS = {"bag": ROS1, "db3": SQLITE, "mcap": MCAP}


@pytest.fixture(params=bags.SUFFIXES)
def written(request, tmp_path):
    suffix = request.param
    path = tmp_path / ("in.bag" if suffix == "bag" else "in")
    with bags.Bag(path, suffix) as bag:
        for k in range(3):
            found = ros.detection(NAMES[suffix], ros.at(0, 0, 1 + k))
            bag.detect(bags.EPOS, ros.detections(10 + k, found), bags.START_S + k)
    return path, suffix


def test_the_name_of_a_file_says_its_kind():
    assert kind_of("a.BAG") == ROS1 and kind_of("a.mcap") == MCAP and kind_of("a") is None


def test_messages_are_read_by_time(written):
    path, suffix = written
    with BagReader(path) as reader:
        assert (reader.kind, len(reader)) == (KINDS[suffix], 3)
        assert reader.topics() == {bags.EPOS: DETECTIONS}
        topics = reader.connections_of(bags.EPOS, [DETECTIONS])
        reader.understand(topics)
        found = [(time, reader.read(c, raw)) for c, time, raw in reader.messages(topics)]
    assert [time for time, _ in found] == [round((bags.START_S + k) * ros.NS) for k in range(3)]
    poses = [m.detections[0].results[0].pose.pose for _, m in found]
    assert [pose.position.z for pose in poses] == [1, 2, 3]


def test_topics_are_named_where_one_is_unknown_or_of_another_type(written):
    path, _ = written
    with BagReader(path) as reader:
        with pytest.raises(
            UnknownNameError, match=r"\(vision_msgs.*did you mean /epos/detections\?"
        ):
            reader.connections_of("/epos/detection", [DETECTIONS])
        with pytest.raises(InputError, match="should be of type a/msg/B or a/msg/C, but is vision"):
            reader.connections_of(bags.EPOS, ["a/msg/B", "a/msg/C"])


def test_content_of_another_type_is_named(written):
    path, _ = written
    with BagReader(path) as reader:
        (topic,) = reader.connections_of(bags.EPOS, [DETECTIONS])
        reader.understand([topic])
        with pytest.raises(FormatError, match=r"topic /epos/detections: a message cannot be read"):
            reader.read(topic, b"\x00\x01\x00\x00\xff")


def test_metadata_that_is_none_is_refused(tmp_path):
    (tmp_path / "in").mkdir()
    for text in ("", "[]", "rosbag2_bagfile_information: {version: 99}", ": ["):
        (tmp_path / "in" / "metadata.yaml").write_text(text)
        with pytest.raises(FormatError, match="cannot be opened"):
            BagReader(tmp_path / "in")


@pytest.mark.parametrize(
    ("error", "kind", "says"),
    [
        (PermissionError(13, "denied"), InputError, "may not be read"),
        (MemoryError(), FormatError, "a part of it says that it is larger than the memory"),
        (InputError("said already"), InputError, "^said already$"),
    ],
)
def test_errors_of_reading_are_named(written, monkeypatch, error, kind, says):
    path, _ = written

    def refuse(self):
        raise error

    monkeypatch.setattr(BagReader, "_open", refuse)
    with pytest.raises(kind, match=says):
        BagReader(path)
