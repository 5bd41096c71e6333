"""The ROS packages agree with the library and with their documentation; rclpy is not needed."""

from __future__ import annotations

import ast
import re
import tomllib
from pathlib import Path
from xml.etree import ElementTree

import pytest

from graspcast.ros.parameters import PARAMETERS, node_settings

ROOT = Path(__file__).parents[1]
NODE = ROOT / "ros" / "graspcast_ros"
PACKAGES = (NODE, ROOT / "ros" / "graspcast_msgs")


def file_parameters() -> dict[str, object]:
    """The parameters in the file to start from, which is YAML of one list or number a line."""
    text = (NODE / "config" / "judge.yaml").read_text("utf-8")
    found = dict(re.findall(r"^    (\w+): (.+)$", text, re.MULTILINE))
    return {name: ast.literal_eval(value) for name, value in found.items()}


def test_the_parameter_file_has_every_parameter_of_its_type_and_serves():
    given = file_parameters()
    assert list(given) == [p.name for p in PARAMETERS]
    for parameter in PARAMETERS:
        assert type(given[parameter.name]) is type(parameter.default), parameter.name
    assert node_settings(given).topics.keys() == {"epos", "gdrnpp"}


def test_the_documentation_has_every_parameter_and_field():
    text = (ROOT / "docs" / "ros.md").read_text("utf-8")
    named = set(re.findall(r"`([\w~/]+)`", text))
    assert {p.name for p in PARAMETERS} <= named
    for message in (ROOT / "ros" / "graspcast_msgs" / "msg").glob("*.msg"):
        lines = [line.split() for line in message.read_text("utf-8").splitlines()]
        fields = {
            w[1] for w in lines if len(w) == 2 and not w[0].startswith("#") and "=" not in w[1]
        }
        assert {f for f in fields if not f.endswith("_known")} <= named


@pytest.mark.parametrize("package", PACKAGES, ids=lambda p: p.name)
def test_manifests_name_what_is_used(package):
    root = ElementTree.parse(package / "package.xml").getroot()
    assert root.findtext("name") == package.name and root.findtext("license") == "Apache-2.0"
    license_of_all = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
    assert license_of_all["project"]["license"].startswith("Apache-2.0")
    depends = {e.text for e in root if e.tag.endswith("depend")}
    used = set()
    for path in (*package.glob("graspcast_ros/*.py"), *package.glob("launch/*.py")):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            names = [node.module] if isinstance(node, ast.ImportFrom) else []
            names += [a.name for a in node.names] if isinstance(node, ast.Import) else []
            used |= {name.split(".")[0] for name in names}
    assert used - {"functools", "importlib", "pathlib", "sys", "graspcast"} <= depends


def test_the_node_only_wires():
    """Whatever it computes is in graspcast.ros."""
    tree = ast.parse((NODE / "graspcast_ros" / "node.py").read_text("utf-8"))
    ours = {
        node.module
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("graspcast.")
    }
    assert {name for name in ours if not name.startswith("graspcast.ros.")} == {"graspcast.errors"}
