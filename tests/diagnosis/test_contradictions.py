"""One table with both outcomes of a trial."""

from __future__ import annotations

from pathlib import Path

import pytest

from graspcast.diagnosis.contradictions import repeated_in_one
from graspcast.errors import FormatError
from graspcast.estimates.outcomes import read_outcomes

HEADER = "estimator,dataset,scene_id,im_id,obj_id,gripper,success\n"


@pytest.mark.parametrize(("second", "found"), [("0", True), ("1", False)])
def test_trials_that_come_twice(tmp_path: Path, second: str, found: bool) -> None:
    path = tmp_path / "trials.csv"
    path.write_text(f"{HEADER}epos,lmo,2,3,5,parallel,1\nepos,lmo,2,3,5,parallel,{second}\n")
    with pytest.raises(FormatError) as caught:
        read_outcomes(path)
    finding = repeated_in_one(path, caught.value)
    assert (finding is not None) == found
    assert finding is None or finding.numbers == {"contradicting": 1}


def test_other_refusals_and_other_files_are_none(tmp_path: Path) -> None:
    shared = FormatError("t.parquet", "rows 1 and 2 share their trial")
    assert repeated_in_one(Path("t.parquet"), shared) is None
    assert repeated_in_one(Path("t.csv"), FormatError("t.csv", "has no rows")) is None
