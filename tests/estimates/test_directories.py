"""BOP directories that estimates belong to."""

from __future__ import annotations

from pathlib import Path

import pytest

from bop_images import estimates_of, write_dataset
from graspcast.bop.results import write_results
from graspcast.errors import InputError, MismatchError
from graspcast.estimates.directories import named_directories, open_directories
from graspcast.estimates.loading import load_inputs

UUID = "_7c9f443f-b900-41bb-af01-09b8eddfc2c4"


def test_the_split_is_that_of_the_estimates(tmp_path: Path) -> None:
    made = write_dataset(tmp_path / "tless_v2")
    estimates = estimates_of(made)
    made.scenes.rename(made.root / "test_primesense")
    for split in ("val", "test_kinect"):
        (made.root / split / "000001").mkdir(parents=True)
    for name in ("m_tless_v2-test-primesense", f"m_tless_v2-test-primesense{UUID}"):
        path = tmp_path / f"{name}.csv"
        write_results(path, estimates)
        inputs = load_inputs({"m": path}, bop=[made.root])
        assert inputs.datasets["tless_v2"].scenes.name == "test_primesense"
        assert len(inputs.datasets["tless_v2"].ground_truth) == len(estimates)
    validation = [(Path("m_tless_v2-val.csv"), "tless_v2")]
    opened = open_directories(named_directories([made.root]), validation)
    assert opened["tless_v2"].scenes.name == "val"
    with pytest.raises(MismatchError, match=r"several splits: .* of test_primesense, .* of val;"):
        open_directories(named_directories([made.root]), [(path, "tless_v2"), *validation])


def test_a_split_that_is_elsewhere_is_not_looked_for(tmp_path: Path) -> None:
    made = write_dataset(tmp_path / "made")
    named = named_directories([made.root], [made.scenes])
    files = [(Path("m_made-val.csv"), "made")]
    assert open_directories(named, files)["made"].scenes == made.scenes
    assert open_directories(named_directories([made.root]), files)["made"].scenes == made.scenes


def test_directories_are_checked_before_they_are_read(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    with pytest.raises(InputError, match="already a dataset x"):
        named_directories([("x", tmp_path / "a"), ("x", tmp_path / "b")])
    with pytest.raises(InputError, match="no such directory"):
        named_directories([tmp_path / "none"])
    with pytest.raises(InputError, match="1 directories of ground truth for 2"):
        named_directories([tmp_path / "a", tmp_path / "b"], [tmp_path])
