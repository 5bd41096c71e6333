"""Export of a checkpoint to an ONNX file with half-precision weights and metadata."""

from __future__ import annotations

import json
import platform
from pathlib import Path

import mujoco
import numpy as np
import onnx
import torch
from onnx import helper, numpy_helper

from graspcast import __version__
from graspcast.io.files import atomic_write
from training.crops import Objects
from training.losses import Geometry
from training.networks import PIXELS
from training.train import BATCH, Run, new_network

_OUTPUTS = {"dense": ["cells"], "direct": ["pose", "cells"], "keypoints": ["heat"]}
_SMALL = 64
"""Smaller tensors stay in single precision."""


def export(work: Path, objects: Objects, name: str, out: Path) -> None:
    """Write the averaged weights of the latest checkpoint as an ONNX file."""
    run = Run(name, objects, work)
    if not run.step:
        raise SystemExit(f"{run.path}: no such checkpoint")
    network = new_network(name, objects).eval()
    network.load_state_dict(run.average.module.state_dict())
    example = (torch.zeros(1, 3, PIXELS, PIXELS), torch.zeros(1, dtype=torch.int64))
    program = torch.onnx.export(
        network,
        example,
        input_names=["image", "object"],
        output_names=_OUTPUTS[name],
        opset_version=18,
        dynamo=True,
        verbose=False,
    )
    model = program.model_proto
    _halve(model)
    about = {"family": name, "pixels": PIXELS, "objects": _objects(objects), "made": _made(run)}
    helper.set_model_props(model, {"graspcast": json.dumps(about)})
    onnx.checker.check_model(model)
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


def _objects(objects: Objects) -> list[dict]:
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


def _made(run: Run) -> dict:
    return {
        "steps": run.step,
        "batch": BATCH,
        "graspcast": __version__,
        "torch": torch.__version__,
        "mujoco": mujoco.__version__,
        "python": platform.python_version(),
    }
