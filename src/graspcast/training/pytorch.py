"""PyTorch: whether it is installed, and the device that it computes on."""

from __future__ import annotations

from importlib.util import find_spec

from graspcast.errors import ExtraMissingError, InputError, UnknownNameError

__all__ = ["DEVICES", "check_installed", "choose_device"]

DEVICES = ("auto", "cpu", "cuda")
"""Devices by name; ``auto`` is a CUDA GPU that PyTorch sees, else the CPU."""

_PACKAGES = ("torch", "onnx", "onnxscript")


def check_installed() -> None:
    """Raise unless all that training needs is installed.

    Raises
    ------
    ExtraMissingError
        Naming the first package that is missing, and how to install it.
    """
    for package in _PACKAGES:
        if find_spec(package) is None:
            raise ExtraMissingError(package, "train")


def choose_device(name: str = "auto") -> str:
    """Return ``cpu`` or ``cuda``.

    Raises
    ------
    UnknownNameError
        If there is no such device.
    InputError
        If it is ``cuda``, and PyTorch sees no CUDA GPU.
    """
    import torch

    if name not in DEVICES:
        raise UnknownNameError("device", name, DEVICES)
    seen = torch.cuda.is_available()
    if name == "cuda" and not seen:
        raise InputError(
            f"PyTorch {torch.__version__} sees no CUDA GPU here; train on the CPU",
            parameters=("device",),
        )
    return "cuda" if seen and name != "cpu" else "cpu"
