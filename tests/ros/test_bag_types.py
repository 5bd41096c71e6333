from types import SimpleNamespace

import numpy as np
import pytest

from graspcast.errors import FormatError
from graspcast.ros.bag_types import maker_of, own_types, types_of
from graspcast.ros.definitions import DETECTIONS, TRANSFORMS

pytest.importorskip("rosbags", reason="pip install 'graspcast[rosbag]'")

from rosbags.interfaces import MessageDefinition, MessageDefinitionFormat


def connection(text, kind=MessageDefinitionFormat.MSG, name="x/msg/Y"):
    return SimpleNamespace(msgdef=MessageDefinition(kind, text), msgtype=name, topic="/y")


def test_definitions_of_the_bag_are_used():
    types = types_of([connection("float64 a\nstring b\n")], "a.bag", ros1=False)
    message = types.types["x/msg/Y"](a=1.5, b="c")
    back = types.deserialize_cdr(types.serialize_cdr(message, "x/msg/Y"), "x/msg/Y")
    assert (back.a, back.b) == (1.5, "c")


def test_definitions_in_idl_are_read_alone_and_several_in_one_text():
    one = "module x { module msg { struct Y { double a; }; }; };"
    two = "module x { module msg { struct Z { x::msg::Y y; }; }; };"
    line = "=" * 80 + "\n"
    several = f"{line}IDL: x/msg/Z\n{two}\n{line}IDL: x/msg/Y\n{one}\n"
    for text, names in ((one, {"x/msg/Y"}), (several, {"x/msg/Y", "x/msg/Z"})):
        types = types_of([connection(text, MessageDefinitionFormat.IDL)], "a", ros1=False)
        assert names <= set(types.types)


@pytest.mark.parametrize("ros1", [True, False])
def test_without_definitions_the_published_ones_are_used(ros1):
    bare = connection("", MessageDefinitionFormat.NONE, DETECTIONS)
    assert {DETECTIONS, TRANSFORMS} <= set(types_of([bare], "a.bag", ros1=ros1).types)


@pytest.mark.parametrize("text", ["float64", "]]]", "float64[ a"])
def test_definitions_that_cannot_be_read_name_bag_and_topic(text):
    with pytest.raises(FormatError, match=r"a\.bag, topic /y: the definition of x/msg/Y"):
        types_of([connection(text)], "a.bag", ros1=False)


@pytest.mark.parametrize(
    "text",
    [
        'float64 a\nstring X="""); import os; os.system(\'touch pwned\')  #\n',
        "float64 a\nuint8 A=__import__('os').getpid()\n",
        'string a "\'; raise SystemExit"\n',
    ],
)
def test_constants_and_defaults_in_definitions_are_no_code(text, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    try:
        types = types_of([connection(text)], "a.bag", ros1=False)
    except FormatError:
        pass
    else:
        assert types.fielddefs["x/msg/Y"][0] == []
    assert list(tmp_path.iterdir()) == []


def test_names_in_definitions_are_plain_names(monkeypatch):
    import rosbags.typesys

    fields = [("a: int\n    import os", (1, ("float64", 0)))]
    monkeypatch.setattr(rosbags.typesys, "get_types_from_msg", lambda *_: {"x/msg/Y": ([], fields)})
    with pytest.raises(FormatError, match="which is no name"):
        types_of([connection("anything")], "a.bag", ros1=False)


def test_a_maker_for_ros_1_takes_the_fields_of_ros_2():
    make = maker_of(own_types(ros1=True), ros1=True)
    stamp = make("builtin_interfaces/msg/Time", sec=1, nanosec=2)
    assert make("std_msgs/msg/Header", stamp=stamp, frame_id="c").seq == 0
    hypothesis = make("vision_msgs/msg/ObjectHypothesis", class_id="7", score=0.5)
    pose = make("geometry_msgs/msg/PoseWithCovariance", pose=None, covariance=np.zeros(36))
    result = make("vision_msgs/msg/ObjectHypothesisWithPose", hypothesis=hypothesis, pose=pose)
    assert (result.id, result.score) == (7, 0.5)
