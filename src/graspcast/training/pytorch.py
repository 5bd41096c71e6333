"""PyTorch: the device that it computes on."""

from __future__ import annotations

from graspcast.errors import InputError, UnknownNameError

__all__ = ["DEVICES", "choose_device"]

DEVICES = ("auto", "cpu", "cuda")
"""Devices by name; ``auto`` is a CUDA GPU that PyTorch sees, else the CPU."""


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
