from pathlib import Path

import numpy as np
import pytest

import ros_bags as bags
import ros_messages as ros
from episode_world import CAMERAS, FOUND, NAMES, World, new_world
from graspcast.errors import FormatError, InputError, UnknownNameError
from graspcast.ros.bag_reader import BagReader
from graspcast.ros.conversion import convert_bag
from graspcast.ros.settings import Settings
from graspcast.runtime.frame import Estimate, Frame
from graspcast.runtime.watcher import Watcher

pytest.importorskip("rosbags", reason="pip install 'graspcast[rosbag]'")

OBJECTS = ("d-1", "d-2")
TOPICS = {name: f"/{name}/detections" for name in NAMES}
VERDICTS, DETECTIONS = "/graspcast/verdicts", "/graspcast/detections"
START = bags.START_S
IMAGES = 3


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> World:
    return new_world(tmp_path_factory.mktemp("world"))


@pytest.fixture
def watcher(world: World) -> Watcher:
    return Watcher(world.forecaster, models=world.models, threshold=0.7)


def classes(suffix: str) -> dict[str, str]:
    """ROS 1 has numbers for classes."""
    names = ("1", "2") if suffix == "bag" else ("mug", "bowl")
    return dict(zip(names, OBJECTS, strict=True))


def settings(suffix: str, **given) -> Settings:
    known = {"camera_frame": ros.CAMERA, "world_frame": ros.BASE, "objects": classes(suffix)}
    return Settings(**(known | given))


def put_image(bag: bags.Bag, suffix: str, image: int, names=NAMES) -> None:
    """Write an image's detections, each a little later than its stamp, between two transforms."""
    time_s = START + image
    for near in (time_s - 0.05, time_s + 0.05):
        camera = ros.transform(ros.BASE, "hand", CAMERAS[image], near)
        bag.move(near, camera)
    for k, name in enumerate(names):
        found = [
            ros.detection(label, FOUND[name][image, n]) for n, label in enumerate(classes(suffix))
        ]
        bag.detect(TOPICS[name], ros.detections(time_s, *found), time_s + 0.1 + 0.01 * k)


def written(folder: Path, suffix: str) -> Path:
    """A bag of some images, with a topic of no interest in it; the same bytes every time."""
    if suffix not in _WRITTEN:
        made = written_with(folder, suffix)
        files = [made] if made.is_file() else sorted(made.iterdir())
        _WRITTEN[suffix] = {p.relative_to(folder).as_posix(): p.read_bytes() for p in files}
        return made
    for name, content in _WRITTEN[suffix].items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)
    return folder / next(iter(_WRITTEN[suffix])).partition("/")[0]


_WRITTEN: dict[str, dict[str, bytes]] = {}


def written_with(folder: Path, suffix: str, **options) -> Path:
    path = folder / ("in.bag" if suffix == "bag" else f"in_{suffix}")
    with bags.Bag(path, suffix, **options) as bag:
        for image in range(IMAGES):
            put_image(bag, suffix, image)
            time = bag.make("std_msgs/msg/String", data=f"noise {image}")
            bag.put(bags.NOISE, "std_msgs/msg/String", time, START + image)
        # Latched: it holds for the whole bag, though it comes last.
        bag.move(START + IMAGES, ros.transform("hand", ros.CAMERA, np.eye(4)), topic="/tf_static")
    return path


def target(folder: Path, suffix: str) -> Path:
    return folder / f"out.{suffix}"


def of(messages, topic: str) -> list:
    return [message for name, _, message in messages if name == topic]


@pytest.fixture(
    params=[pytest.param(s, marks=[] if s == "mcap" else pytest.mark.slow) for s in bags.SUFFIXES]
)
def suffix(request) -> str:
    return request.param


def test_a_bag_keeps_its_messages_and_gets_the_watchers_verdicts(tmp_path, watcher, suffix):
    path, out = written(tmp_path, suffix), target(tmp_path, suffix)
    done = convert_bag(path, out, watcher, TOPICS, settings(suffix))
    before, after = bags.read_bag(path), bags.read_bag(out)
    kept = [m for m in after if m[0] not in (VERDICTS, DETECTIONS)]
    assert [(t, s) for t, s, _ in kept] == [(t, s) for t, s, _ in before]
    assert [m.data for m in of(kept, bags.NOISE)] == [f"noise {k}" for k in range(IMAGES)]
    assert (done.messages, done.frames, done.judged) == (len(before), IMAGES, IMAGES)
    assert not done.problems
    arrays = of(after, VERDICTS)
    assert [a.header.stamp.sec for a in arrays] == [int(START) + k for k in range(IMAGES)]
    for image, array in enumerate(arrays):
        estimates = {
            name: [Estimate(o, FOUND[name][image, k], 0.9) for k, o in enumerate(OBJECTS)]
            for name in NAMES
        }
        answer = watcher.judge(Frame(estimates, CAMERAS[image], time_s=START + image))
        assert len(array.verdicts) == len(answer) == 2
        for verdict, decision in zip(array.verdicts, answer, strict=True):
            assert verdict.object_name == decision.object_name
            assert ("abstain", "look again", "attempt")[verdict.action] == decision.action
            assert verdict.probability == pytest.approx(decision.probability, abs=1e-9)
            assert verdict.guide == decision.guide and verdict.world_pose_known
    scores = [d.results[0] for a in of(after, DETECTIONS) for d in a.detections]
    assert len(scores) == 2 * IMAGES


def test_verdicts_come_after_what_they_were_made_of(tmp_path, watcher):
    path, out = written(tmp_path, "mcap"), tmp_path / "out.mcap"
    convert_bag(path, out, watcher, TOPICS, settings("mcap"))
    last = {}
    for topic, time, message in bags.read_bag(out):
        if topic in TOPICS.values():
            last[message.header.stamp.sec] = time
        elif topic == VERDICTS:
            assert time == last[message.header.stamp.sec]


@pytest.mark.parametrize(
    ("read", "out", "kind"),
    [
        pytest.param("db3", "out", "SQLite", marks=pytest.mark.slow),
        pytest.param("mcap", "out", "MCAP", marks=pytest.mark.slow),
        ("db3", "out.mcap", "MCAP"),
        ("mcap", "out.db3", "SQLite"),
        ("bag", "out.bag", "ROS 1"),
    ],
)
def test_the_name_of_the_output_chooses_the_format(tmp_path, watcher, read, out, kind):
    path = written(tmp_path, read)
    assert convert_bag(path, tmp_path / out, watcher, TOPICS, settings(read)).kind == kind
    assert len(of(bags.read_bag(tmp_path / out), VERDICTS)) == IMAGES
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted([path.name, out])
    with BagReader(tmp_path / out) as reader:
        assert reader.kind == kind


def test_single_files_of_ros_2_can_be_read(tmp_path, watcher):
    folder = written(tmp_path, "mcap")
    (path,) = folder.glob("*.mcap")
    done = convert_bag(path, tmp_path / "out.mcap", watcher, TOPICS, settings("mcap"))
    assert done.judged == IMAGES


def test_frames_of_a_static_scene_are_looks(tmp_path, watcher):
    out = tmp_path / "out.mcap"
    given = settings("mcap", episodes="static")
    convert_bag(written(tmp_path, "mcap"), out, watcher, TOPICS, given)
    arrays = of(bags.read_bag(out), VERDICTS)
    assert [a.look for a in arrays] == [1, 2, 3] and len({a.episode for a in arrays}) == 1
    assert arrays[2].verdicts[0].views == 3


def test_a_missing_estimator_is_in_the_verdicts_and_counted(tmp_path, watcher, suffix):
    path = tmp_path / ("in.bag" if suffix == "bag" else "in")
    with bags.Bag(path, suffix) as bag:
        put_image(bag, suffix, 0, NAMES)
        put_image(bag, suffix, 1, NAMES[:1])
    topics = TOPICS
    done = convert_bag(
        path, target(tmp_path, suffix), watcher, topics, settings(suffix, camera_frame="hand")
    )
    # All detections are in a frame that tf does not connect with this camera's.
    assert done.judged == 2 and f"image without a message by {NAMES[1]}" in done.problems.counts()
    missing = [a.missing for a in of(bags.read_bag(target(tmp_path, suffix)), VERDICTS)]
    assert missing == [[], list(NAMES[1:])]


@pytest.mark.slow
def test_compressed_bags_are_read(tmp_path, watcher):
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import CompressionFormat, CompressionMode

    lz4 = {"set_compression": (Writer1.CompressionFormat.LZ4,)}
    for k, mode in enumerate((CompressionMode.FILE, CompressionMode.MESSAGE)):
        (folder := tmp_path / str(k)).mkdir()
        zstd = {"set_compression": (mode, CompressionFormat.ZSTD)}
        path = written_with(folder, "db3", **zstd)
        done = convert_bag(path, folder / "out", watcher, TOPICS, settings("db3"))
        assert done.judged == IMAGES
    path = written_with(tmp_path, "bag", **lz4)
    assert convert_bag(path, tmp_path / "o.bag", watcher, TOPICS, settings("bag")).judged == IMAGES


def test_an_unknown_topic_is_answered_with_the_bags_topics_and_types(tmp_path, watcher):
    path = written(tmp_path, "mcap")
    topics = TOPICS | {NAMES[0]: "/epos"}
    with pytest.raises(UnknownNameError, match=r"'/epos'.*/noise \(std_msgs/msg/String\)"):
        convert_bag(path, tmp_path / "out.mcap", watcher, topics, settings("mcap"))
    with pytest.raises(InputError, match=r"topic /noise: should be of type vision_msgs.*String"):
        convert_bag(
            path, tmp_path / "out.mcap", watcher, TOPICS | {NAMES[0]: "/noise"}, settings("mcap")
        )
    with pytest.raises(UnknownNameError, match=r"estimator 'sam'"):
        convert_bag(
            path, tmp_path / "out.mcap", watcher, {"sam": TOPICS[NAMES[0]]}, settings("mcap")
        )
    with pytest.raises(InputError, match="estimators have topics of their own"):
        same = dict.fromkeys(NAMES, TOPICS[NAMES[0]])
        convert_bag(path, tmp_path / "out.mcap", watcher, same, settings("mcap"))
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


@pytest.mark.slow
def test_outputs_that_cannot_be_are_refused_before_the_work(tmp_path, watcher):
    path = written(tmp_path, "mcap")
    (tmp_path / "there").mkdir()
    for out, said in [
        ("out.bag", "messages of ROS 1 and ROS 2 differ"),
        ("there", "exists; a directory is not replaced"),
        (path.name, "is the bag that is read"),
        (f"{path.name}/inside.mcap", "is the bag that is read"),
    ]:
        with pytest.raises(InputError, match=said):
            convert_bag(path, tmp_path / out, watcher, TOPICS, settings("mcap"))
    convert_bag(path, tmp_path / "out.mcap", watcher, TOPICS, settings("mcap"))
    with pytest.raises(InputError, match="has the topic /graspcast/verdicts already"):
        convert_bag(tmp_path / "out.mcap", tmp_path / "2.mcap", watcher, TOPICS, settings("mcap"))
    again = convert_bag(
        tmp_path / "out.mcap",
        tmp_path / "2.mcap",
        watcher,
        TOPICS,
        settings("mcap"),
        prefix="/again/",
    )
    assert again.judged == IMAGES
    topics = {topic for topic, _, _ in bags.read_bag(tmp_path / "2.mcap")}
    assert {VERDICTS, "/again/verdicts"} <= topics


@pytest.mark.parametrize("prefix", ["bad name", "judged", "/7", "/a//b", "/a\nb", "/é"])
def test_a_prefix_that_is_no_topic_is_refused(tmp_path, watcher, prefix):
    path = written(tmp_path, "mcap")
    with pytest.raises(InputError, match="the prefix of topics is as /graspcast"):
        convert_bag(path, tmp_path / "o.mcap", watcher, TOPICS, settings("mcap"), prefix=prefix)
    assert not (tmp_path / "o.mcap").exists()


def test_poses_in_millimetres_are_counted_and_named(tmp_path, watcher):
    path = tmp_path / "in"
    with bags.Bag(path, "mcap") as bag:
        for k, name in enumerate(NAMES):
            pose = FOUND[name][0, 0].copy()
            pose[:3, 3] *= 1000
            found = ros.detection(next(iter(classes("mcap"))), pose)
            bag.detect(TOPICS[name], ros.detections(START, found), START + 0.1 + 0.01 * k)
    given = settings("mcap", world_frame="")
    done = convert_bag(path, tmp_path / "o.mcap", watcher, TOPICS, given)
    assert dict(done.actions) == {"abstain": 1}
    (line,) = [said for said in done.problems.lines() if "without a pose that can be" in said]
    assert "is it in millimetres" in line


def test_classes_of_ros_1_are_numbers(tmp_path, watcher):
    path = written(tmp_path, "bag")
    with pytest.raises(InputError, match="whole numbers, not 'mug'"):
        convert_bag(path, tmp_path / "o.bag", watcher, TOPICS, settings("mcap"))


def test_a_message_that_is_none_is_counted_and_kept(tmp_path, watcher, suffix):
    path = tmp_path / ("in.bag" if suffix == "bag" else "in")
    with bags.Bag(path, suffix) as bag:
        put_image(bag, suffix, 0)
        bag.raw(TOPICS[NAMES[0]], b"\x00\x01\x00\x00garbage", START + 0.5)
        bag.raw(TOPICS[NAMES[0]], b"", START + 0.6)
    done = convert_bag(
        path, target(tmp_path, suffix), watcher, TOPICS, settings(suffix, camera_frame="hand")
    )
    assert done.problems.counts()["message that cannot be read"] == 2
    with BagReader(target(tmp_path, suffix)) as reader:
        assert len(reader) == done.messages + 2


def files_of(path: Path) -> Path:
    """The file with the messages."""
    return path if path.is_file() else next(p for p in path.iterdir() if p.suffix != ".yaml")


def test_cut_bags_are_refused_and_nothing_is_written(tmp_path, watcher, suffix):
    path = written(tmp_path, suffix)
    content = files_of(path).read_bytes()
    for share in (0.0, 0.001, 0.3, 0.6, 0.9):
        files_of(path).write_bytes(content[: int(share * len(content))])
        with pytest.raises(FormatError, match="is damaged, was not closed"):
            convert_bag(path, target(tmp_path, suffix), watcher, TOPICS, settings(suffix))
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


def test_what_is_no_bag_is_refused(tmp_path, watcher):
    (tmp_path / "empty").mkdir()
    (tmp_path / "text.mcap").write_text("no bag")
    (tmp_path / "table.csv").write_text("no bag")
    for name, said in [
        ("none.bag", "there is no such bag"),
        ("empty", "directory without metadata.yaml"),
        ("table.csv", r"should be a \.bag, \.db3, \.mcap file"),
        ("text.mcap", "cannot be opened"),
    ]:
        with pytest.raises(InputError, match=said):
            convert_bag(tmp_path / name, tmp_path / "o.mcap", watcher, TOPICS, settings("mcap"))


def test_an_empty_bag_has_no_topics(tmp_path, watcher, suffix):
    path = tmp_path / ("in.bag" if suffix == "bag" else "in")
    with bags.Bag(path, suffix):
        pass
    with pytest.raises(UnknownNameError, match="known: none"):
        convert_bag(path, target(tmp_path, suffix), watcher, TOPICS, settings(suffix))


@pytest.mark.parametrize(
    "seed", [pytest.param(k, marks=pytest.mark.slow if k > 2 else []) for k in range(8)]
)
def test_flipped_bytes_end_in_a_bag_or_in_an_error_of_ours(tmp_path, watcher, suffix, seed):
    path = written(tmp_path, suffix)
    content = bytearray(files_of(path).read_bytes())
    rng = np.random.default_rng(seed)
    for at in rng.integers(0, len(content), size=4 ** (seed % 4)):
        content[at] = rng.integers(256)
    files_of(path).write_bytes(bytes(content))
    try:
        convert_bag(path, target(tmp_path, suffix), watcher, TOPICS, settings(suffix))
    except InputError:
        assert [p.name for p in tmp_path.iterdir()] == [path.name]
    else:
        assert sorted(p.name for p in tmp_path.iterdir()) == sorted([path.name, f"out.{suffix}"])


@pytest.mark.slow
def test_images_are_judged_in_batches_as_all_at_once(tmp_path, watcher, monkeypatch):
    bag = written(tmp_path, "mcap")
    convert_bag(bag, tmp_path / "whole.mcap", watcher, TOPICS, settings("mcap"))
    monkeypatch.setattr("graspcast.ros.conversion._BATCH", 1)
    monkeypatch.setattr("graspcast.ros.conversion._REPORTED_EVERY", 5)
    shares = []
    done = convert_bag(
        bag,
        tmp_path / "parts.mcap",
        watcher,
        TOPICS,
        settings("mcap"),
        progress=lambda share, message: shares.append(share),
    )
    assert shares == sorted(shares) and len(shares) >= 2 and shares[-1] <= 1
    assert done.judged == IMAGES
    one, other = (
        of(bags.read_bag(tmp_path / name), VERDICTS) for name in ("whole.mcap", "parts.mcap")
    )
    for a, b in zip(one, other, strict=True):
        assert [(v.object_name, v.action, v.probability) for v in a.verdicts] == [
            (v.object_name, v.action, v.probability) for v in b.verdicts
        ]


def test_a_frame_that_cannot_be_judged_is_counted_and_the_others_have_verdicts(
    tmp_path, world, monkeypatch
):
    watcher = Watcher(world.forecaster, models=world.models, threshold=0.7)
    real, error = watcher.judge, InputError("the log cannot be written")

    def judge(frame, episode=None):
        if frame.time_s == START + 1:
            raise error
        return real(frame, episode)

    monkeypatch.setattr(watcher, "judge", judge)
    out, given = tmp_path / "out.mcap", settings("mcap", episodes="static")
    done = convert_bag(written(tmp_path, "mcap"), out, watcher, TOPICS, given)
    assert (done.frames, done.judged) == (IMAGES, IMAGES - 1)
    assert any(
        "could not be judged" in line and str(error) in line for line in done.problems.lines()
    )
    assert [a.look for a in of(bags.read_bag(out), VERDICTS) if a.verdicts] == [1, 2]
    monkeypatch.setattr(watcher, "judge_all", lambda frames: [error for _ in frames])
    done = convert_bag(
        written(tmp_path / "2", "mcap"), tmp_path / "2.mcap", watcher, TOPICS, settings("mcap")
    )
    assert (done.frames, done.judged) == (IMAGES, 0)
