"""Sources of poses side by side."""

from __future__ import annotations

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
