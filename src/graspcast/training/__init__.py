"""Training of the built-in pose estimators on rendered images, with PyTorch (extra ``train``).

Modules that need PyTorch are imported when something is trained, by
:mod:`graspcast.training.run`.
"""
