"""Grippers of two boxes, with an opening, a gap and a force that are known, for tests."""

from __future__ import annotations

from pathlib import Path
from string import Template
from typing import Any

MJCF = Template("""
<mujoco model="jaws">
  <compiler angle="radian" autolimits="true"/>
  <default>
    <default class="jaw">
      <geom type="box" size="0.01 0.02 0.03" pos="0 0 0.03" mass="0.1"/>
      <joint type="slide" damping="$damping" armature="0.1" range="-0.001 0.05"/>
    </default>
  </default>
  <worldbody>
    <body name="$root">$joints
      <geom type="box" size="0.06 0.03 0.02" pos="$x 0 -0.02" mass="0.5"/>
      <site name="tcp" pos="$x $y $z" quat="$quat"/>
      <body name="l" pos="$left 0 0"><joint name="jl" axis="-1 0 0" class="jaw"/>
        <geom class="jaw"$collides/></body>
      <body name="r" pos="$right 0 0"><joint name="jr" axis="1 0 0" class="jaw"/>
        <geom class="jaw"$collides/></body>
    </body>
  </worldbody>
  <actuator>
    <position name="l" joint="jl" kp="$kp" forcerange="-$force $force" ctrlrange="0 0.05"/>
    <position name="r" joint="jr" kp="$kp" forcerange="-$force $force" ctrlrange="0 0.05"/>
  </actuator>
  $more
</mujoco>
""")

TOML = Template("""
name = "jaws"
model = "jaws.xml"
max_opening_m = $opening
$tcp

[closing]
seconds = 0.8
open = $open
close = $close
""")

X, Y = "0.70710678 0 0.70710678 0", "0.70710678 0 0 0.70710678"
"""Quaternions of a quarter of a turn about y, from z to x, and about z, from x to y."""


def write_jaws(folder: Path, **changes: Any) -> Path:
    """Write two jaws, each 20 mm thick, that open to 94 mm about the TCP, and return the TOML.

    At a joint position q the inner surfaces are q + 2 mm from the middle; the pads reach from 0 to
    60 mm along z, and the TCP is at 50 mm. A saturated servo presses with ``force``.
    """
    values: dict[str, Any] = {
        **{"x": 0.0, "y": 0.0, "z": 0.05, "quat": "1 0 0 0", "off": 0.0, "kp": 3000, "force": 40},
        **{"damping": 40},
        **{"root": "hand", "joints": "", "collides": "", "more": "", "opening": 0.094},
        **{"tcp": 'tcp_site = "tcp"'},
        **{"open": "{ l = 0.045, r = 0.045 }", "close": "{ l = 0.0, r = 0.0 }"},
        **changes,
    }
    values["left"], values["right"] = values["off"] - 0.012, values["off"] + 0.012
    folder.mkdir(exist_ok=True)
    (folder / "jaws.xml").write_text(MJCF.substitute(values))
    (folder / "jaws.toml").write_text(TOML.substitute(values))
    return folder / "jaws.toml"


_LINK = Template("""
  <link name="$name">
    <inertial><mass value="0.1"/>
      <inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial>
    <visual><geometry><mesh filename="package://jaws/visual/$name.dae"/></geometry></visual>
    $collision
  </link>""")

_BOX = '<collision><origin xyz="{}"/><geometry><box size="{}"/></geometry></collision>'

_SLIDE = Template("""
  <joint name="j$side" type="prismatic">
    <parent link="palm"/><child link="$side"/><origin xyz="$x 0 0"/><axis xyz="$axis 0 0"/>
    <limit lower="0" upper="0.05" effort="$effort" velocity="0.2"/><dynamics damping="40"/>$mimic
  </joint>""")


def write_urdf_jaws(folder: Path, **changes: Any) -> Path:
    """Write the same jaws as URDF, the second of which mimics the first, and return the TOML."""
    values: dict[str, Any] = {
        **{"effort": 40, "palm": _BOX.format("0 0 -0.02", "0.12 0.06 0.04"), "more": ""},
        **{"jaw": _BOX.format("0 0 0.03", "0.02 0.04 0.06"), "tcp": 'tcp_body = "tcp"'},
        **{"actuators": "[actuators.drive]\njoint = 'jl'\nstiffness = 3000\narmature = 0.1\n"},
        **{"commands": "open = { drive = 0.045 }\nclose = { drive = 0.0 }"},
        **changes,
    }
    slide = {"effort": values["effort"]}
    robot = [
        '<robot name="jaws">',
        _LINK.substitute(name="palm", collision=values["palm"]),
        _LINK.substitute(name="l", collision=values["jaw"]),
        _LINK.substitute(name="r", collision=values["jaw"]),
        '<link name="tcp"/><joint name="to_tcp" type="fixed"><parent link="palm"/>',
        '<child link="tcp"/><origin xyz="0 0 0.05"/></joint>',
        _SLIDE.substitute(slide, side="l", x=-0.012, axis=-1, mimic=""),
        _SLIDE.substitute(slide, side="r", x=0.012, axis=1, mimic='<mimic joint="jl"/>'),
        values["more"],
        "</robot>",
    ]
    folder.mkdir(exist_ok=True)
    (folder / "jaws.urdf").write_text("\n".join(robot))
    (folder / "jaws.toml").write_text(
        f'name = "jaws"\nmodel = "jaws.urdf"\nmax_opening_m = 0.094\n{values["tcp"]}\n'
        f"[closing]\nseconds = 0.8\n{values['commands']}\n{values['actuators']}"
    )
    return folder / "jaws.toml"
