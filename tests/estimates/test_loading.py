"""Results files and the datasets they belong to, read together."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from bop_images import estimates_of, write_dataset
from graspcast.bop.dataset import BopDataset
from graspcast.bop.results import write_results
from graspcast.errors import InputError, MismatchError, UnknownNameError
from graspcast.estimates.loading import load_inputs, load_outcomes
from poses import random_poses, results_of


@pytest.fixture
def dataset(tmp_path: Path) -> BopDataset:
    return write_dataset(tmp_path / "made")


def write(dataset: BopDataset, names: str = "ab", of: str = "made") -> list[tuple[str, Path]]:
    out = []
    for seed, name in enumerate(names):
        out.append((name, dataset.root.parent / f"{name}_{of}-test.csv"))
        write_results(out[-1][1], estimates_of(dataset, seed))
    return out


def test_files_belong_to_the_dataset_in_their_names(dataset: BopDataset) -> None:
    paths = [*write(dataset, "ab"), *write(dataset, "b", of="other")]
    inputs = load_inputs(paths)
    assert {name: list(tables) for name, tables in inputs.results.items()} == {
        "made": ["a", "b"],
        "other": ["b"],
    }
    assert inputs.estimators == ("b",), "only b has estimates on both"
    assert inputs.objects == {"made-1", "made-5", "other-1", "other-5"}
    assert inputs.models == {}
    with pytest.raises(MismatchError, match="by its name a CSV of dataset other"):
        load_inputs(paths, bop=[(None, dataset.root)])
    renamed = load_inputs(paths[2:], bop=[("other", dataset.root)])
    assert list(renamed.datasets) == ["other"] and list(renamed.models) == ["other"]


def test_a_file_without_a_dataset_belongs_to_the_only_one(dataset: BopDataset) -> None:
    path = dataset.root.parent / "estimates.csv"
    write_results(path, estimates_of(dataset, 0))
    assert list(load_inputs([("a", path)], bop=[(None, dataset.root)]).results) == ["made"]
    with pytest.raises(InputError, match="of which dataset") as caught:
        load_inputs([("a", path)])
    assert caught.value.parameters == ("bop",)


def test_one_directory_of_ground_truth_for_each_dataset(dataset: BopDataset) -> None:
    paths, bop = write(dataset), [(None, dataset.root)]
    truth = dataset.root / "test"
    assert load_inputs(paths, bop=bop, ground_truth=[truth]).estimators == ("a", "b")
    with pytest.raises(InputError, match="2 directories of ground truth for 1 BOP") as caught:
        load_inputs(paths, bop=bop, ground_truth=[truth, truth])
    assert caught.value.parameters == ("ground_truth", "bop")
    with pytest.raises(InputError, match="is given twice, as estimates by a"):
        load_inputs([*paths, paths[0]], bop=bop)


def test_only_the_wanted_objects_and_scenes(dataset: BopDataset) -> None:
    inputs = load_inputs(write(dataset), bop=[(None, dataset.root)], objects=["5"], scenes=[1])
    for table in inputs.results["made"].values():
        assert set(table.obj_id.tolist()) == {5} and set(table.scene_id.tolist()) == {1}


def test_aligned_estimates_and_their_true_poses(dataset: BopDataset) -> None:
    paths = write(dataset)
    write_results(paths[1][1], estimates_of(dataset, 1).select(np.arange(1, 6)))
    inputs = load_inputs(paths, bop=[(None, dataset.root)])
    aligned = inputs.estimates("a")
    assert len(aligned) == 5
    assert inputs.notes == ["dropped instances without an estimate: 1 by b"]
    truth = inputs.truth(aligned, "a")
    assert truth is not None
    known = dataset.ground_truth
    for i in range(5):
        (row,) = np.flatnonzero(
            (known.scene_id == aligned.scene_id[i])
            & (known.im_id == aligned.im_id[i])
            & (known.obj_id == aligned.obj_id[i])
        )
        np.testing.assert_array_equal(truth[i], known.cam_T_obj[row])
    assert len(inputs.estimates(only=("a",))) == 6  # one alone serves with several views


def test_missing_ground_truth_is_an_error(dataset: BopDataset) -> None:
    paths = write(dataset)
    for path in dataset.root.glob("test/*/scene_gt.json"):
        path.unlink()
    inputs = load_inputs(paths, bop=[(None, dataset.root)])
    with pytest.raises(InputError, match=r"need ground truth: .*scene_gt.json"):
        inputs.truth(inputs.estimates(), "a")


def test_outcomes_of_none_of_the_estimators_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "outcomes.csv"
    columns = ["estimator", "dataset", "scene_id", "im_id", "obj_id", "gripper", "success"]
    rows = [("a", "made", 1, 3, 1, "parallel", 1), ("b", "made", 1, 3, 1, "parallel", 0)]
    pl.DataFrame(rows, schema=columns, orient="row").write_csv(path)
    assert load_outcomes([path], ["b", "c"])["success"].to_list() == [1, 0]
    with pytest.raises(UnknownNameError, match=r"unknown estimator 'c, d'.*known: a, b"):
        load_outcomes([path], ["c", "d"])
    path.write_text(",".join(columns) + "\n")
    with pytest.raises(InputError, match=r"outcomes.csv: holds no outcome") as none:
        load_outcomes([path], ["a"])
    assert none.value.parameters == ("outcomes",)


def test_one_file_under_two_names_is_refused(tmp_path: Path) -> None:
    poses = random_poses(4)
    for name, given in (("a", poses), ("copy", poses), ("other", random_poses(4, 1))):
        write_results(tmp_path / f"{name}_made-test.csv", results_of(given))
    a, copy, other = (tmp_path / f"{n}_made-test.csv" for n in ("a", "copy", "other"))
    for second in (a, copy):
        with pytest.raises(InputError, match=r"holds the same poses as .* agreement with itself"):
            load_inputs([("a", a), ("b", second)])
    assert load_inputs([("a", a), ("b", other)]).estimators == ("a", "b")


def test_a_note_says_that_ranks_are_those_of_the_rows_left(tmp_path: Path) -> None:
    paths = {name: tmp_path / f"{name}_made-test.csv" for name in "ab"}
    for seed, path in enumerate(paths.values()):
        write_results(path, results_of(random_poses(4, seed)))
    text = paths["a"].read_text().splitlines()
    paths["a"].write_text("\n".join([*text, text[-1].replace(text[-1].split(",")[3], "nan", 1)]))
    (note,) = load_inputs(paths, lenient=True).notes
    assert note.endswith("dropped 1 rows (bad row); est_id ranks the rows that are left")


def test_no_estimate_left_is_one_message(dataset: BopDataset) -> None:
    bop = [dataset.root]
    paths = write(dataset)
    with pytest.raises(
        InputError, match=r"no estimate is left of object 7; the file has objects 1"
    ):
        load_inputs(paths, bop=bop, objects=["7"])
    with pytest.raises(InputError, match=r"no estimate is left in scene 9; .* in scenes 1, 2"):
        load_inputs(paths, bop=bop, scenes=[9])
    with pytest.raises(
        InputError, match="objects lmo-1: there are only estimates of dataset made"
    ) as caught:
        load_inputs(paths, bop=bop, objects=["lmo-1"])
    assert "objects" in caught.value.parameters
    header = paths[0][1].read_text().splitlines()[0]
    empty = dataset.root.parent / r"none_made-test.csv"
    empty.write_text(header + "\n")
    with pytest.raises(InputError, match=r"none_made-test.csv: holds no estimate"):
        load_inputs([("none", empty)], bop=bop)
    inputs = load_inputs([*paths, ("none", empty)], bop=bop)
    assert inputs.notes == [f"{empty}: holds no estimate"]
    with pytest.raises(MismatchError, match=r"none: 0 rows\); .*none_made-test.csv holds no"):
        inputs.estimates()
    bad = dataset.root.parent / "bad_made-test.csv"
    bad.write_text(f"{header}\n1,3,1,nan,1 0 0 0 1 0 0 0 1,0 0 900,-1\n")
    with pytest.raises(InputError, match=r"holds no estimate: 1 left out \(bad row\)"):
        load_inputs([("bad", bad)], bop=bop, lenient=True)


def test_an_object_of_one_dataset_leaves_the_others_out(dataset: BopDataset) -> None:
    other = write_dataset(dataset.root.parent / "other")
    bop = [dataset.root, other.root]
    paths = [*write(dataset), *write(dataset, of="other")]
    inputs = load_inputs(paths, bop=bop, objects=["made-1"])
    assert inputs.objects == {"made-1"} and inputs.notes == []
    inputs = load_inputs(paths, bop=bop, objects=["made-1", "other-5", "7"])
    assert inputs.objects == {"made-1", "other-5"}
    assert inputs.notes == ["there is no estimate of object 7"]


def test_objects_and_scenes_that_the_dataset_lacks_are_named(dataset: BopDataset) -> None:
    bop, root = [dataset.root], dataset.root.parent
    stated, unstated = root / "a_made-test.csv", root / "results.csv"
    table = estimates_of(dataset, 0)
    for path in (stated, unstated):
        write_results(path, replace(table, scene_id=table.scene_id + 50))
    (note,) = load_inputs([("a", stated)], bop=bop).notes
    assert "scenes 51, 52, which are not in" in note and "it has 1, 2" in note
    with pytest.raises(MismatchError, match=r"scenes 51, 52, which .* another dataset or split\?"):
        load_inputs([("a", unstated)], bop=bop)
    write_results(stated, replace(table, obj_id=table.obj_id + 20))
    for lenient in (False, True):
        with pytest.raises(InputError, match=r"objects 21, 25 are not in .* has 1, 5; are these"):
            load_inputs([("a", stated)], bop=bop, lenient=lenient)
    write_results(stated, replace(table, obj_id=np.where(table.obj_id == 5, 7, 1)))
    with pytest.raises(InputError, match=r"object 7 is not in .*leave unknown objects out"):
        load_inputs([("a", stated)], bop=bop)
    inputs = load_inputs([("a", stated)], bop=bop, lenient=True)
    assert inputs.objects == {"made-1"}
    assert inputs.notes == [f"{stated}: dropped 3 rows (object without a model: 7)"]
    assert load_inputs([("a", stated)], bop=bop, without_models=True).objects == {"made-1"}


def test_no_file_of_another_dataset_is_read_leniently(dataset: BopDataset) -> None:
    """Its name states this dataset, but neither the scenes nor all objects are of it."""
    ((_, path),) = write(dataset, "a")
    found = estimates_of(dataset, 0)
    other = replace(found, obj_id=np.where(found.obj_id == 1, 77, found.obj_id))
    write_results(path, other)
    inputs = load_inputs([("a", path)], bop=[(None, dataset.root)], lenient=True)
    assert "object without a model" in " ".join(inputs.notes)
    write_results(path, replace(other, scene_id=other.scene_id + 100))
    with pytest.raises(MismatchError, match=r"neither its scenes .* nor its objects 77 are in"):
        load_inputs([("a", path)], bop=[(None, dataset.root)], lenient=True)
