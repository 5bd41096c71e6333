"""PyTorch is optional, and the device a choice."""

from __future__ import annotations

import pytest

from graspcast.errors import ExtraMissingError, InputError, UnknownNameError
from graspcast.training import pytorch
from graspcast.training.pytorch import check_installed, choose_device


def test_what_is_missing_is_named_with_the_line_that_installs_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(pytorch, "find_spec", lambda name: None if name == "onnx" else object())
    with pytest.raises(ExtraMissingError, match=r"needs onnx, .*pip install 'graspcast\[train\]'"):
        check_installed()


def test_devices() -> None:
    torch = pytest.importorskip("torch", reason="needs PyTorch: pip install 'graspcast[train]'")
    assert choose_device("cpu") == "cpu"
    assert choose_device() == ("cuda" if torch.cuda.is_available() else "cpu")
    with pytest.raises(UnknownNameError, match="known: auto, cpu, cuda"):
        choose_device("tpu")
    if not torch.cuda.is_available():
        with pytest.raises(InputError, match="sees no CUDA GPU"):
            choose_device("cuda")
