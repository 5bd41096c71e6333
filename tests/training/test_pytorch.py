"""PyTorch is optional, and the device a choice."""

from __future__ import annotations

import pytest

from graspcast.errors import InputError, UnknownNameError
from graspcast.training.pytorch import choose_device


def test_devices() -> None:
    torch = pytest.importorskip("torch", reason="needs PyTorch: pip install 'graspcast[train]'")
    assert choose_device("cpu") == "cpu"
    assert choose_device() == ("cuda" if torch.cuda.is_available() else "cpu")
    with pytest.raises(UnknownNameError, match="known: auto, cpu, cuda"):
        choose_device("tpu")
    if not torch.cuda.is_available():
        with pytest.raises(InputError, match="sees no CUDA GPU"):
            choose_device("cuda")
