"""The page from a mesh to verdicts: its first commands, which CI runs as they stand."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest
import trimesh

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "no-images.md").read_text()
FIRST = re.findall(r"^```sh\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)[0]


def test_five_commands_lead_from_a_mesh_to_verdicts() -> None:
    verbs = re.findall(r"^ *graspcast ([a-z-]+)", FIRST, re.MULTILINE)
    assert verbs == ["add-object", "propose-grasps", "simulate", "train", "predict"]
    assert FIRST.splitlines()[-1].endswith("--out verdicts.csv")


def test_every_file_is_the_mesh_or_written_by_a_command() -> None:
    text = FIRST.replace("\\\n", " ")
    written = {"mug.stl"}
    for line in text.splitlines():
        words = line.split()
        read = set(re.findall(r"[\w/-]+\.(?:stl|toml|npz|csv)", line))
        out = {words[i + 1] for i, word in enumerate(words) if word == "--out"}
        folders = {name.partition("/")[0] for name in written}
        assert all(n in written or n.partition("/")[0] in folders for n in read - out), line
        written |= out


@pytest.mark.slow
def test_ci_makes_a_mug_that_is_closed(tmp_path: Path) -> None:
    mesh = tmp_path / "mug.stl"
    subprocess.run([sys.executable, ROOT / ".ci" / "mug.py", mesh], check=True)
    assert trimesh.load(mesh).is_watertight
