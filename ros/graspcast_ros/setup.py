"""Setup of the ROS 2 package; built by colcon."""

from pathlib import Path

from setuptools import setup

NAME = "graspcast_ros"


def files(pattern):
    """Return the files of a pattern, as setuptools wants them."""
    return [str(path) for path in Path().glob(pattern)]


setup(
    name=NAME,
    version="0.1.0",
    packages=[NAME],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", files("launch/*.launch.py")),
        (f"share/{NAME}/config", files("config/*.yaml")),
    ],
    install_requires=["setuptools"],
    zip_safe=True,
    maintainer="The graspcast authors",
    maintainer_email="noreply@example.com",
    description="Verdicts on the grasps that pose estimates would guide, as a lifecycle node.",
    license="Apache-2.0",
    entry_points={"console_scripts": [f"judge = {NAME}.node:main"]},
)
