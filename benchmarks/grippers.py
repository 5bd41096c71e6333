"""Which grippers hold what: measured properties and trials of test objects, as a Markdown table.

    python benchmarks/grippers.py [GRIPPER ...] [--robosuite DIR] [--out FILE.md]

Without names, the built-in hands and those of MuJoCo Menagerie that are at hand (see
``MENAGERIE_ROOT``) are tried. ``--robosuite`` names the folder ``robosuite/models/assets/grippers``
of an installation of robosuite; ``benchmarks/robosuite_grippers.toml`` says how its hands are used.

Every object weighs 0.3 kg, has a friction of 0.8, and is grasped from above without error: square
columns half a width below their top, a ball of 60 mm and a can of 66 mm 30 mm below it, or higher
where the fingertips would otherwise meet the table.
"""

from __future__ import annotations

import argparse
import tomllib
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from graspcast.errors import GraspcastError
from graspcast.io import markdown
from graspcast.io.files import atomic_write
from graspcast.io.toml import TomlTable
from graspcast.simulation.grippers import GRIPPERS, load_gripper
from graspcast.simulation.grippers.menagerie import menagerie_names
from graspcast.simulation.grippers.mjcf import MjcfGripper
from graspcast.simulation.grippers.protocol import Gripper
from graspcast.simulation.objects.types import Grasp, GraspObject, Primitive, box_corners
from graspcast.simulation.trial.gripper_bench import grasp_of_column, standing_column
from graspcast.simulation.trial.gripper_conformance import check_gripper
from graspcast.simulation.trial.trial import TrialRunner

HERE = Path(__file__).parent
WIDTHS = (20, 40, 60, 80, 100)
MASS, FRICTION, DEPTH_M = 0.3, 0.8, 0.03


def round_object(name: str, radius: float, half_height: float | None = None) -> GraspObject:
    """Return a ball, or with half a height a standing can; its origin is its centre."""
    height = radius if half_height is None else half_height
    standing = np.eye(4)
    standing[2, 3] = height
    if half_height is None:
        piece = Primitive("sphere", (radius,), np.eye(4))
        inertia = 0.4 * MASS * radius**2 * np.eye(3)
    else:
        piece = Primitive("cylinder", (radius, half_height), np.eye(4))
        across = MASS / 12 * (3 * radius**2 + 4 * half_height**2)
        inertia = np.diag([across, across, 0.5 * MASS * radius**2])
    return GraspObject(
        name=name,
        vertices=box_corners(np.array([radius, radius, height]) / np.sqrt(3)),
        faces=np.zeros((0, 3), dtype=np.int64),
        pieces=(piece,),
        mass_kg=MASS,
        friction=FRICTION,
        centroid=np.zeros(3),
        inertia=inertia,
        sim_T_ref=standing,
    )


def trial(gripper: Gripper, target: GraspObject, tip_m: float) -> str:
    """Run the grasp of an object from above, and return its outcome's reason."""
    if target.name == "test column":
        grasp = grasp_of_column(gripper, float(np.ptp(target.vertices[:, 0])))
    else:
        obj_T_grasp = np.diag([1.0, -1.0, -1.0, 1.0])
        top = target.sim_T_ref[2, 3]  # and as far below the origin is the table
        obj_T_grasp[2, 3] = max(0.0, top - DEPTH_M, tip_m + 0.003 - top)
        grasp = Grasp(obj_T_grasp, target.name, gripper.name)
    return TrialRunner(target, gripper).run(np.eye(4), grasp).reason


def row(gripper: Gripper) -> list[str]:
    """Return a gripper's row: what was measured, the failed checks, and what it holds."""
    report = check_gripper(gripper)
    measured = report.measured
    failed = ", ".join(check.name for check in report.failures) or "passes"
    if measured is None:
        return [gripper.name, "", "", failed, *[""] * (len(WIDTHS) + 2)]
    cells = [gripper.name, f"{1e3 * measured.opening_m:.0f}", f"{measured.grip_n:.0f}", failed]
    if not measured.grip_n > 1:
        cells[2] = f"{measured.grip_n:.1f}"
    for width in WIDTHS:
        if width >= 1e3 * measured.opening_m:
            cells.append("too wide")
            continue
        column = standing_column(1e-3 * width, mass_kg=MASS, friction=FRICTION)
        cells.append(trial(gripper, column, measured.tip_m))
    others = (round_object("ball", 0.03), round_object("can", 0.033, 0.05))
    return [*cells, *(trial(gripper, target, measured.tip_m) for target in others)]


def robosuite_hands(folder: Path) -> Iterator[Gripper]:
    """Load robosuite's hands, as ``robosuite_grippers.toml`` describes them."""
    path = HERE / "robosuite_grippers.toml"
    for name, values in tomllib.loads(path.read_text()).items():
        values.update(name=name, model=str(folder.resolve() / values["model"]))
        yield MjcfGripper.from_table(path, TomlTable(path, f"[{name}]", values))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("grippers", nargs="*", metavar="GRIPPER", help="names or TOML files")
    parser.add_argument("--robosuite", type=Path, metavar="DIR", help="robosuite's grippers")
    parser.add_argument("--out", type=Path, metavar="FILE", help="write the table there, too")
    options = parser.parse_args()
    hands: list[Gripper] = []
    for name in options.grippers or [*GRIPPERS, *menagerie_names()]:
        try:
            hands.append(load_gripper(name))
        except GraspcastError as error:
            if options.grippers:
                raise
            print(f"left out: {error}")
    if options.robosuite:
        hands += robosuite_hands(options.robosuite)
    rows = []
    for hand in hands:
        rows.append(row(hand))
        print(*rows[-1], sep=" | ", flush=True)
    columns = [f"column {width} mm" for width in WIDTHS]
    header = ["gripper", "opens to, mm", "presses, N a side", "check-gripper", *columns]
    table = markdown.table([*header, "ball 60 mm", "can 66 mm"], rows)
    print(table)
    if options.out:
        with atomic_write(options.out) as temporary:
            Path(temporary).write_text(table + "\n")


if __name__ == "__main__":
    main()
