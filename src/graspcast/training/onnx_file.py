"""ONNX files of trained networks: weights in half precision, and metadata on their objects."""

from __future__ import annotations

import json
import logging
import platform
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import torch
from onnx import helper, numpy_helper

from graspcast._version import __version__
from graspcast.io.files import atomic_write
from graspcast.perception.network import METADATA
from graspcast.training.checkpoint import Checkpoint
from graspcast.training.fitting import BATCH
from graspcast.training.geometry import Geometry
from graspcast.training.networks import PIXELS
from graspcast.training.objects import Objects
from graspcast.training.settings import TrainingSettings

__all__ = ["add_metadata", "export"]

_OUTPUTS = {"dense": ["cells"], "direct": ["pose", "cells"], "keypoints": ["heat"]}
_SMALL = 64
"""Smaller tensors stay in single precision."""


def export(checkpoint: Checkpoint, objects: Objects, settings: TrainingSettings, out: Path) -> None:
    """Write the averaged weights of a network as an ONNX file, atomically.

    The metadata hold the estimator, the name of the dataset, the objects with diameters, boxes and
    keypoints, and how the weights were made.
    """
    example = (torch.zeros(1, 3, PIXELS, PIXELS), torch.zeros(1, dtype=torch.int64))
    # The exporter logs that torchvision is absent, and warns of its own use of PyTorch.
    log = logging.getLogger("torch.onnx")
    level = log.level
    log.setLevel(logging.ERROR)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            program = torch.onnx.export(
                checkpoint.averaged(objects),
                example,
                input_names=["image", "object"],
                output_names=_OUTPUTS[checkpoint.name],
                opset_version=18,
                dynamo=True,
                verbose=False,
            )
    finally:
        log.setLevel(level)
    model = program.model_proto
    _halve(model)
    about = {
        "family": checkpoint.name,
        "pixels": PIXELS,
        "dataset": objects.dataset,
        "objects": _objects(objects),
        "made": _made(checkpoint, settings),
    }
    helper.set_model_props(model, {METADATA: json.dumps(about)})
    onnx.checker.check_model(model)
    with atomic_write(out) as temporary:
        temporary.write_bytes(model.SerializeToString())


def add_metadata(path: Path, more: Mapping[str, Any], out: Path) -> None:
    """Write a network with more entries in its metadata; the network itself stays as it is.

    Parameters
    ----------
    path
        An ONNX file that :func:`export` wrote.
    more
        Entries that are added, or replace those of the same names.
    out
        The file to write, atomically.
    """
    model = onnx.load(path)
    about = {p.key: p.value for p in model.metadata_props}
    content = {**json.loads(about[METADATA]), **more}
    helper.set_model_props(model, {**about, METADATA: json.dumps(content)})
    with atomic_write(out) as temporary:
        temporary.write_bytes(model.SerializeToString())


def _halve(model: onnx.ModelProto) -> None:
    """Store weights in half precision, with a cast to single precision before their use.

    ONNX Runtime folds the casts when it loads the network; arithmetic is in single precision.
    """
    casts = []
    for tensor in model.graph.initializer:
        values = numpy_helper.to_array(tensor)
        if tensor.data_type != onnx.TensorProto.FLOAT or values.size < _SMALL:
            continue
        name = tensor.name
        tensor.CopyFrom(numpy_helper.from_array(values.astype(np.float16), name + "/16"))
        casts.append(helper.make_node("Cast", [name + "/16"], [name], to=onnx.TensorProto.FLOAT))
    nodes = [*casts, *model.graph.node]
    del model.graph.node[:]
    model.graph.node.extend(nodes)
    # The exporter's notes on each node's origin are larger than the network.
    for node in model.graph.node:
        del node.metadata_props[:]
        node.doc_string = ""
    del model.graph.value_info[:]
    for value in [*model.graph.input, *model.graph.output, *model.graph.initializer]:
        del value.metadata_props[:]


def _objects(objects: Objects) -> list[dict[str, Any]]:
    geometry = Geometry.of(objects)
    return [
        {
            "obj_id": obj_id,
            "diameter_m": round(float(geometry.diameter[k]), 7),
            "lower": np.round(geometry.low[k].tolist(), 7).tolist(),
            "size": np.round(geometry.size[k].tolist(), 7).tolist(),
            "keypoints": np.round(geometry.keypoints[k].tolist(), 7).tolist(),
        }
        for k, obj_id in enumerate(objects.ids)
    ]


def _made(checkpoint: Checkpoint, settings: TrainingSettings) -> dict[str, Any]:
    from graspcast.simulation.engine import mujoco

    return {
        "steps": checkpoint.step,
        "batch": BATCH,
        "images": settings.images,
        "seed": settings.seed,
        "strength": settings.strength,
        "graspcast": __version__,
        "torch": torch.__version__,
        "mujoco": mujoco.__version__,
        "python": platform.python_version(),
    }
