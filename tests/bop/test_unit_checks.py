"""Lengths in BOP's files that contradict each other are found, with both numbers."""

from __future__ import annotations

import numpy as np
import pytest

from graspcast.bop.unit_checks import (
    camera_problem,
    diameter_problem,
    distance_problem,
    mesh_problem,
    models_problem,
    outline_problem,
    ratio_problem,
    symmetry_problem,
)
from graspcast.pose.lengths import METRES, UNIT_NAMES

DISTANCE = np.array([0.7, 0.8, 0.9])
DIAMETER = np.array([0.1, 0.12, 0.11])
OTHERS = [unit for unit in METRES if unit != "mm"]
SIZE = np.array([0.06, 0.04, 0.1])
CORNERS = np.stack(np.meshgrid(*(np.array([-0.5, 0.5])[:, None] * SIZE).T), -1).reshape(-1, 3)
ACROSS = float(np.linalg.norm(SIZE))


def read_as_mm(length: object, unit: str) -> np.ndarray:
    """Return what is read of a length that is written in ``unit`` instead of millimetres."""
    return np.asarray(length) * METRES["mm"] / METRES[unit]


def suggested(said: str) -> str:
    """Return the unit that a message suggests first."""
    return said.partition("is it in ")[2].partition(" (")[0]


@pytest.mark.parametrize("unit", OTHERS)
def test_distances_in_another_unit_are_found(unit: str) -> None:
    said = distance_problem("t", read_as_mm(DISTANCE, unit), DIAMETER)
    assert suggested(said) == UNIT_NAMES[unit]
    assert f"median distance of t is {1000 * read_as_mm(0.8, unit):.3g} mm" in said
    assert "an object 110 mm across should be 110 mm to 5.50 m away" in said


@pytest.mark.parametrize("unit", OTHERS)
def test_models_in_another_unit_are_found_by_the_distances(unit: str) -> None:
    said = distance_problem("t", DISTANCE, read_as_mm(DIAMETER, unit))
    assert UNIT_NAMES[unit] in said
    assert f"median diameter in models_info.json is {1000 * read_as_mm(0.11, unit):.3g} mm" in said
    assert "the median distance of t is 0.80 m" in said


@pytest.mark.parametrize("unit", OTHERS)
def test_sources_in_different_units_are_found_whichever_is_wrong(unit: str) -> None:
    wrong = read_as_mm(DISTANCE, unit)
    for said in (
        ratio_problem("a.csv", wrong, "the truth", DISTANCE),
        ratio_problem("the truth", DISTANCE, "a.csv", wrong),
    ):
        assert suggested(said) == UNIT_NAMES[unit]
        assert f"in a.csv is {1000 * read_as_mm(0.8, unit):.3g} mm" in said
        assert "in the truth they are 0.80 m away" in said


@pytest.mark.parametrize("unit", ["m", "inch"])
def test_models_that_no_hand_grasps_are_found_without_poses(unit: str) -> None:
    said = models_problem(read_as_mm(DIAMETER, unit))
    assert UNIT_NAMES[unit] in said
    assert "but a hand grasps 5 mm to 1.00 m" in said


@pytest.mark.parametrize("unit", OTHERS)
def test_diameter_bounds_and_mesh_must_agree(unit: str) -> None:
    wrong = float(read_as_mm(ACROSS, unit))
    said = diameter_problem(wrong, SIZE)
    assert suggested(said) == UNIT_NAMES[unit]
    assert "the longest side of the bounding box is 100 mm" in said
    said = diameter_problem(ACROSS, read_as_mm(SIZE, unit))
    assert suggested(said) == UNIT_NAMES[unit]
    assert "the diameter is 123 mm" in said
    said = mesh_problem(wrong, read_as_mm(-SIZE / 2, unit), CORNERS)
    assert suggested(said) == UNIT_NAMES[unit]
    assert "but the mesh's longest side is 100 mm" in said
    said = mesh_problem(ACROSS, -SIZE / 2, read_as_mm(CORNERS, unit))
    assert suggested(said) == UNIT_NAMES[unit]
    assert "its diameter in models_info.json is 123 mm" in said


def test_what_fits_has_no_problem() -> None:
    assert distance_problem("t", DISTANCE, DIAMETER) == ""
    assert distance_problem("t", DISTANCE) == ""
    assert distance_problem("t", np.empty(0), np.empty(0)) == ""
    assert distance_problem("t", DISTANCE, np.full(3, np.nan)) == ""
    assert ratio_problem("a", DISTANCE, "b", 1.8 * DISTANCE) == ""
    assert ratio_problem("a", np.zeros(3), "b", DISTANCE) == ""
    assert models_problem(DIAMETER) == ""
    assert diameter_problem(ACROSS, SIZE) == ""
    assert mesh_problem(1.05 * ACROSS, -0.52 * SIZE, CORNERS) == ""


def test_a_corner_elsewhere_than_the_mesh_is_found() -> None:
    said = mesh_problem(ACROSS, np.array([-0.03, -0.02, 0.0]), CORNERS)
    assert said == "min_z in models_info.json is 0 mm, but the mesh begins at -50 mm"


@pytest.mark.parametrize("unit", OTHERS)
def test_symmetries_must_keep_the_object_where_it_is(unit: str) -> None:
    half_turn, centre = np.diag([-1.0, -1.0, 1.0]), np.array([0.2, 0.0, 0.0])
    moved = np.array([0.4, 0.0, 0.0])
    assert symmetry_problem(half_turn, moved, centre, ACROSS) == ""
    said = symmetry_problem(half_turn, read_as_mm(moved, unit), centre, ACROSS)
    assert "but the object is 123 mm across" in said
    assert f"is it in {UNIT_NAMES[unit]}, not in millimetres?" in said


K = np.array([[572.4, 0, 325.3], [0, 573.6, 242.0], [0, 0, 1]])


@pytest.mark.parametrize(
    ("matrix", "says"),
    [
        (K, ""),
        (K.T, "is transposed"),
        (
            np.diag([1 / 640, 1 / 480, 1]) @ K,
            "focal lengths 0.8944 and 1.195, which are not in pixels",
        ),
        (np.diag([-1, 1, 1]) @ K, "should be positive pixels"),
        (np.diag([3, 1, 1]) @ K, "should be about equal"),
        (K + [[0, 0, 5000], [0, 0, 0], [0, 0, 0]], "far outside the image of 640x480 pixels"),
        (np.diag([100, 100, 1]) @ K, "but the image is 640 pixels wide"),
        (2 * K, "its last row is 0 0 2, not 0 0 1"),
    ],
)
def test_matrices_that_are_no_intrinsics_in_pixels_are_named(matrix: np.ndarray, says: str) -> None:
    said = camera_problem(np.asarray(matrix), (640, 480))
    assert says in said
    assert bool(says) == bool(said)


@pytest.mark.parametrize("unit", OTHERS)
def test_depths_must_fit_the_size_in_the_images(unit: str) -> None:
    focal = np.full(3, 600.0)
    boxes = 0.8 * focal * DIAMETER / DISTANCE
    assert outline_problem(DISTANCE, boxes, DIAMETER, focal) == ""
    said = outline_problem(read_as_mm(DISTANCE, unit), boxes, DIAMETER, focal)
    assert suggested(said) == UNIT_NAMES[unit]
    assert "a focal length of 600 pixels and diameters of 110 mm make it at most 1.00 m" in said
    said = outline_problem(DISTANCE, boxes, read_as_mm(DIAMETER, unit), focal)
    assert "the median depth of cam_t_m2c is 0.80 m, but boxes of" in said
