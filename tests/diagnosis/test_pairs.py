"""Sources of poses side by side."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path

import numpy as np

from graspcast.diagnosis.pairs import TRUTH, pairs_of, sources_of
from sick_files import case_of, healthy


def test_every_two_sources(tmp_path: Path) -> None:
    case = case_of(healthy().write(tmp_path))
    sources, scenes = sources_of(case)
    assert list(sources) == ["a", "b", TRUTH]
    assert scenes is case.scenes[0]
    pairs = pairs_of(sources, case.name)
    assert list(pairs) == [("a", "b"), ("a", TRUTH), ("b", TRUTH)]
    pair = pairs["a", TRUTH]
    assert len(pair) == 48
    np.testing.assert_array_equal(pair.swapped().poses, pair.others)
    assert np.median(pair.apart(case)) < 0.05


def test_what_was_found_wrong_is_no_source(tmp_path: Path) -> None:
    case = case_of(healthy().write(tmp_path))
    case.blamed |= {"a", TRUTH}
    assert list(sources_of(case)[0]) == ["b"]


def test_sources_without_a_common_instance_are_no_pair(tmp_path: Path) -> None:
    case = case_of(healthy().write(tmp_path))
    a, b = case.results["a"], case.results["b"]
    sources = {"a": a.select(a.obj_id == 1), "b": b.select(b.obj_id == 2), "c": b}
    assert list(pairs_of(sources, case.name)) == [("a", "c"), ("b", "c")]


def test_the_scenes_with_most_of_the_images_are_taken(tmp_path: Path) -> None:
    case = case_of(healthy().write(tmp_path))
    other = case_of(healthy(1).write(tmp_path / "2")).scenes[0]
    assert other.truth is not None
    few = other.truth.im_id < 3
    fewer = replace(
        other.truth,
        **{
            f.name: v[few]
            for f in fields(other.truth)
            if isinstance(v := getattr(other.truth, f.name), np.ndarray)
        },
    )
    case.scenes.append(replace(other, truth=fewer))
    assert sources_of(case)[1] is case.scenes[0]
