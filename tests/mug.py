"""Catalogue entry of a custom object."""

from __future__ import annotations

MUG = """
[objects.mug]
label = "my mug"
mesh = "mug.stl"
mass_kg = 0.3
mass_source = "scales"
friction = 0.6
friction_source = "a guess"
up = [0, 0, 1]
collision = { pieces = 1 }
"""
