from graspcast.attempt_log.episodes import scene_of


def test_an_episode_has_one_number_that_no_published_scene_has():
    assert scene_of("a") == scene_of("a") != scene_of("b")
    assert all(2**52 <= scene_of(str(i)) < 2**53 for i in range(1000))
