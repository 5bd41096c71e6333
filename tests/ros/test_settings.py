import pytest

from graspcast.errors import InputError, UnknownNameError
from graspcast.ros.settings import Settings

KNOWN = frozenset({"ycbv-5", "ycbv-6"})


def test_classes_stand_for_objects_and_objects_for_themselves():
    settings = Settings("camera", objects={"mustard": "ycbv-5"})
    assert settings.object_of("mustard", KNOWN) == "ycbv-5"
    assert settings.object_of("ycbv-6", KNOWN) == "ycbv-6"
    assert settings.object_of("box", KNOWN) is None
    assert settings.class_of("ycbv-5") == "mustard"
    assert settings.class_of("ycbv-6") == "ycbv-6"


def test_a_class_of_an_unknown_object_is_refused_with_the_known_ones():
    Settings("camera", objects={"mustard": "ycbv-5"}).check_objects(KNOWN)
    with pytest.raises(UnknownNameError, match=r"'ycbv-7'.*known: ycbv-5, ycbv-6"):
        Settings("camera", objects={"mustard": "ycbv-7"}).check_objects(KNOWN)


def test_frames_are_named_never_guessed():
    assert Settings("/camera", "/base").camera_frame == "camera"
    assert Settings("camera", "").world_frame is None
    for name in ("", " / "):
        with pytest.raises(InputError, match="optical frame should be named"):
            Settings(name)


def test_several_looks_need_a_world_frame():
    with pytest.raises(InputError, match="need the camera's pose in the world"):
        Settings("camera", episodes="static")
    with pytest.raises(UnknownNameError, match="known: single, static"):
        Settings("camera", episodes="moving")
    assert Settings("camera", "base", episodes="static").episodes == "static"
