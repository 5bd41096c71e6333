"""Fitting: it can be interrupted without a trace, and says how far it is."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="needs PyTorch: pip install 'graspcast[train]'")

from graspcast.training import fitting  # noqa: E402
from graspcast.training.checkpoint import Checkpoint  # noqa: E402
from graspcast.training.fitting import fit  # noqa: E402
from graspcast.training.samples import Samples  # noqa: E402
from graspcast.training.settings import TrainingSettings  # noqa: E402
from stored_crops import boxes, raw  # noqa: E402

SETTINGS = TrainingSettings(estimators=("dense", "keypoints"), steps=4, threads=1)


@pytest.fixture
def samples(tmp_path: Path) -> Samples:
    (tmp_path / "samples").mkdir()
    for k in range(2):
        np.savez(tmp_path / "samples" / f"{k:05d}.npz", **raw())  # type: ignore[arg-type]
    return Samples(tmp_path / "samples")


def run(directory: Path, samples: Samples, progress: object = None) -> list[Checkpoint]:
    made = [Checkpoint(name, boxes(), directory) for name in SETTINGS.estimators]
    fit(made, samples, boxes(), SETTINGS, progress=progress)  # type: ignore[arg-type]
    return made


def test_an_interrupted_run_gives_the_weights_of_a_whole_one(
    samples: Samples, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = run(tmp_path / "whole", samples)
    assert [one.step for one in whole] == [4, 4]
    monkeypatch.setattr(fitting, "_SAVE_S", 0.0)
    monkeypatch.setattr(fitting, "_SAY_S", 0.0)

    def stop(share: float, message: str) -> None:
        if share >= 0.5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run(tmp_path / "cut", samples, stop)
    kept = [Checkpoint(name, boxes(), tmp_path / "cut").step for name in SETTINGS.estimators]
    # The step that was just done had not been saved.
    assert kept == [1, 1]
    said: list[tuple[float, str]] = []
    resumed = run(tmp_path / "cut", samples, lambda *heard: said.append(heard))
    assert [one.step for one in resumed] == [4, 4]
    for mine, other in zip(whole, resumed, strict=True):
        for a, b in zip(mine.network.parameters(), other.network.parameters(), strict=True):
            assert torch.equal(a, b)
    assert said[-1][0] == 1.0
    assert said[0][1].startswith("2 of 4 training steps, loss of dense ")


def test_what_is_done_is_left_alone(samples: Samples, tmp_path: Path) -> None:
    run(tmp_path, samples)
    before = (tmp_path / "dense.pt").read_bytes()
    assert [one.step for one in run(tmp_path, samples)] == [4, 4]
    assert (tmp_path / "dense.pt").read_bytes() == before
