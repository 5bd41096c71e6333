"""Write the mug of docs/no-images.md, a cup with a handle, in mm: python mug.py mug.stl."""

import sys

import numpy as np
import trimesh
from trimesh.transformations import rotation_matrix, translation_matrix

profile = [(0, 0), (31, 0), (33, 2), (33, 95), (30, 95), (30, 5), (0, 5)]
cup = trimesh.creation.revolve(np.array(profile, dtype=float), sections=64)
handle = trimesh.creation.torus(major_radius=24, minor_radius=5)
handle.apply_transform(translation_matrix([45, 0, 50]) @ rotation_matrix(np.pi / 2, [1, 0, 0]))
trimesh.util.concatenate([cup, handle]).export(sys.argv[1])
