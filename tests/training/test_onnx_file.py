"""ONNX files: they compute what the network computes, and say what it was trained for."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="needs PyTorch: pip install 'graspcast[train]'")
pytest.importorskip("onnxscript", reason="needs onnxscript: pip install 'graspcast[train]'")

from graspcast.perception.network import Network  # noqa: E402
from graspcast.training.checkpoint import Checkpoint  # noqa: E402
from graspcast.training.networks import NETWORKS, PIXELS  # noqa: E402
from graspcast.training.onnx_file import add_metadata, export  # noqa: E402
from graspcast.training.settings import TrainingSettings  # noqa: E402
from stored_crops import DIAMETER_M, SIZE, boxes  # noqa: E402


@pytest.mark.parametrize("name", sorted(NETWORKS))
def test_the_file_computes_what_the_network_computes(name: str, tmp_path: Path) -> None:
    checkpoint = Checkpoint(name, boxes(), tmp_path)
    path = tmp_path / f"{name}.onnx"
    export(checkpoint, boxes(), TrainingSettings(images=80), path)
    network = Network(name, path)
    assert network.trained.dataset == "boxes" and list(network.objects) == [1, 5]
    assert network.objects[5].diameter_m == pytest.approx(DIAMETER_M)
    np.testing.assert_allclose(network.objects[1].size, SIZE, atol=1e-6)
    assert network.made["images"] == 80 and network.validation == {}
    crop = np.random.default_rng(0).integers(0, 256, (PIXELS, PIXELS, 3), dtype=np.uint8)
    image = torch.from_numpy(crop).permute(2, 0, 1)[None].float() / 255
    with torch.no_grad():
        wanted = checkpoint.averaged(boxes())(image, torch.tensor([1]))
    wanted = wanted if isinstance(wanted, tuple) else (wanted,)
    found = network(crop, 5)
    for mine, other in zip(found, wanted, strict=True):
        # Weights are kept in half precision.
        np.testing.assert_allclose(mine, other[0].numpy(), atol=2e-2)

    more = tmp_path / "more.onnx"
    add_metadata(path, {"validation": {"images": "some", "errors": []}, "dataset": "other"}, more)
    changed = Network(name, more)
    assert changed.trained.dataset == "other" and changed.validation["images"] == "some"
    assert changed.made == network.made
    for mine, other in zip(found, changed(crop, 5), strict=True):
        np.testing.assert_array_equal(mine, other)
