"""Verdicts on all that was found in a frame."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

import synthetic
from graspcast import train_forecaster
from graspcast.bop.results import Results
from graspcast.errors import MismatchError
from graspcast.forecasting.models.mlp.ensemble import NetworkSettings
from graspcast.forecasting.models.mlp.types import MlpSettings

SHORT = NetworkSettings(members=2, optimiser=MlpSettings(epochs=80, rate=1e-2))


def test_a_frame_gets_a_verdict_on_everything_the_principal_found() -> None:
    data = synthetic.tried(120)
    forecaster = train_forecaster(data, method="MLP-O", settings=SHORT)
    poses = {name: data.estimates.of(name)[:4] for name in data.estimates.estimators}
    frame = {
        name: Results.from_frame(
            {
                "scene_id": np.zeros(4, int),
                "im_id": np.full(4, 9),
                "obj_id": np.array([1, 2, 1, 2]),
                "score": np.array([0.9, 0.8, 0.7, 0.6]),
                "cam_T_obj": pose,
            }
        )
        for name, pose in poses.items()
    }
    rows = forecaster.predict_frame(frame, "d", threshold=0.3)
    assert [row.key[1:] for row in rows] == [(0, 9, 1, 0), (0, 9, 1, 1), (0, 9, 2, 0), (0, 9, 2, 1)]
    for row, i in zip(rows, (0, 2, 1, 3), strict=True):
        assert_allclose(row.cam_T_obj, poses["a"][i], rtol=1e-12)
        assert (row.principal, row.gripper, row.grasp) == ("a", "parallel", "reference")
        alone = {name: pose[i] for name, pose in poses.items()}
        single = forecaster.predict(alone, f"d-{row.key.obj_id}", threshold=0.3)
        assert row.verdict.attempt == single.attempt
    nothing = frame["b"].select(np.zeros(4, bool))
    rows = forecaster.predict_frame({**frame, "b": nothing}, "d")
    assert {str(row.verdict) for row in rows} == {"abstain"}
    assert {row.verdict.reason for row in rows} == {"no estimate by b"}
    assert forecaster.predict_frame({**frame, "a": nothing}, "d") == []
    with pytest.raises(MismatchError, match="there are none by b"):
        forecaster.predict_frame({"a": frame["a"], "c": frame["c"]}, "d")
