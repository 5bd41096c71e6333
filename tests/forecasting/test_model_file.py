"""Model files: whole, or refused."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

import synthetic
from graspcast.bop.models import Models
from graspcast.errors import FormatError
from graspcast.forecasting.forecaster import Forecaster
from graspcast.forecasting.models.blend import ForestSettings
from graspcast.forecasting.train import train_forecaster
from graspcast.io.arrays import read_arrays, write_arrays
from poses import write_models


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Models]:
    folder = write_models(tmp_path_factory.mktemp("models"), obj_1={}, obj_2={})
    return {"d": Models(folder)}


@pytest.fixture(scope="module")
def threshold(models: dict[str, Models]) -> Forecaster:
    return train_forecaster(synthetic.tried(360), method="threshold", models=models)


@pytest.fixture(scope="module")
def whole(threshold: Forecaster, tmp_path_factory: pytest.TempPathFactory) -> bytes:
    return written(threshold, tmp_path_factory.mktemp("model"))


def written(forecaster: Forecaster, folder: Path) -> bytes:
    forecaster.save(folder / "model.npz")
    return (folder / "model.npz").read_bytes()


def refused(path: Path, content: bytes) -> str:
    path.write_bytes(content)
    with pytest.raises(FormatError) as caught:
        Forecaster.load(path)
    assert str(caught.value).startswith(f"{path}: ")
    return str(caught.value)


def test_no_part_of_a_file_is_taken_for_a_model(whole: bytes, tmp_path: Path) -> None:
    lengths = {*range(0, len(whole), max(1, len(whole) // 150)), *range(40), len(whole) - 1}
    for length in lengths:
        assert "train it again" in refused(tmp_path / "model.npz", whole[:length])


@settings(max_examples=100, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(content=st.one_of(st.binary(max_size=200), st.binary(max_size=60).map(b"PK\3\4".__add__)))
def test_bytes_of_any_kind_are_refused(content: bytes, tmp_path: Path) -> None:
    refused(tmp_path / "model.npz", content)


@settings(max_examples=100, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(place=st.integers(0, 10**6), value=st.integers(1, 255))
def test_a_changed_byte_is_refused_or_changes_nothing(
    whole: bytes,
    threshold: Forecaster,
    models: dict[str, Models],
    tmp_path: Path,
    place: int,
    value: int,
) -> None:
    content = bytearray(whole)
    content[place % len(whole)] ^= value
    path = tmp_path / "model.npz"
    path.write_bytes(content)
    unseen = synthetic.estimates(4, seed=9)
    try:
        again = Forecaster.load(path)
    except FormatError:
        return
    expected = threshold.probability(unseen, models)
    assert_array_equal(again.probability(unseen, models), expected)


def test_other_files_are_refused(whole: bytes, tmp_path: Path) -> None:
    path = tmp_path / "model.npz"
    with pytest.raises(FormatError, match="cannot be read"):
        Forecaster.load(tmp_path / "none.npz")
    with pytest.raises(FormatError, match="is a directory"):
        Forecaster.load(tmp_path)
    path.write_bytes(whole)
    arrays = read_arrays(path, "")
    content = json.loads(str(arrays["card"]))
    for changed in (
        [],
        {},
        {"format": content["format"]},
        {"format": content["format"], "card": {}},
        {**content, "card": {**content["card"], "method": "forest"}},
        {**content, "card": {**content["card"], "odd": 1}},
        {**content, "card": {**content["card"], "principal": 1}},
        {**content, "card": {**content["card"], "samples": -1}},
        {**content, "card": {**content["card"], "success_rate": "high"}},
        {**content, "card": {**content["card"], "objects": "d-1"}},
        {**content, "card": {**content["card"], "objects": ["d-1", "d-1"]}},
    ):
        write_arrays(path, arrays | {"card": np.array(json.dumps(changed))})
        assert "not a complete model file" in refused(path, path.read_bytes())
    write_arrays(path, arrays | {"card": np.array(json.dumps({**content, "format": 99}))})
    assert "is a model of format 99, not 5" in refused(path, path.read_bytes())
    np.savez(path, **arrays)
    assert "has no digest" in refused(path, path.read_bytes())
    write_arrays(path, {"x": np.zeros(3)})
    assert "not a complete model file" in refused(path, path.read_bytes())
    np.save(tmp_path / "x.npy", np.zeros(3))
    assert "train it again" in refused(path, (tmp_path / "x.npy").read_bytes())


def test_no_part_of_a_file_with_forests_is_taken_for_a_model(
    models: dict[str, Models], tmp_path: Path
) -> None:
    forecaster = train_forecaster(
        synthetic.training_data(80), forests=ForestSettings(trees=3, folds=0), models=models
    )
    content = written(forecaster, tmp_path)
    path = tmp_path / "part.npz"
    for length in [*range(0, len(content), len(content) // 40), len(content) - 1]:
        assert "train it again" in refused(path, content[:length])
    path.write_bytes(content)
    arrays = read_arrays(path, "")
    needed = [
        *(f"0/predictor/{part}/feature" for part in ("direct", "errors/f", "success_given_error")),
        "0/predictor/errors/members",
        "0/predictor/calibration",
        "0/novelty/scores",
        "0/typical",
    ]
    for name in needed:
        write_arrays(path, {k: v for k, v in arrays.items() if k != name})
        assert "not a complete model file" in refused(path, path.read_bytes())
