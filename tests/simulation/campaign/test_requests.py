from __future__ import annotations

from typing import Any

import numpy as np
import polars as pl
import pytest

from graspcast.errors import (
    InputError,
)
from graspcast.simulation.campaign.requests import TrialRequests


def _changed(requests: TrialRequests, **columns: Any) -> pl.DataFrame:
    return requests.keys.drop("object").with_columns(**columns)


def test_requests_that_are_wrong(requests: TrialRequests) -> None:
    keys, poses = requests.keys, requests.obj_T_est
    with pytest.raises(InputError, match="lack the column 'est_id'"):
        TrialRequests(keys.drop("est_id"), poses)
    with pytest.raises(InputError, match="wrong type"):
        TrialRequests(_changed(requests, im_id=pl.lit("first")), poses)
    with pytest.raises(InputError, match=r"same keys: estimator epos.*im_id 3"):
        TrialRequests(_changed(requests, im_id=pl.lit(3)), poses)
    with pytest.raises(InputError, match="no value in some column"):
        TrialRequests(_changed(requests, gripper=pl.lit(None, dtype=pl.String)), poses)
    with pytest.raises(InputError, match="need poses"):
        TrialRequests(keys, poses[1:])
    broken = poses.copy()
    broken[5, 0, 0] = np.nan
    with pytest.raises(InputError, match=r"1 estimates are not finite.*im_id 5, obj_id 4"):
        TrialRequests(keys, broken)
    broken = poses.copy()
    broken[6, :3, :3] *= 1.01
    with pytest.raises(InputError, match=r"not rigid.*im_id 6"):
        TrialRequests(keys, broken)
