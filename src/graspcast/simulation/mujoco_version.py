"""The installed MuJoCo: which packages own its folder, and whether its files fit together."""

from __future__ import annotations

import re
import sys
from dataclasses import dataclass
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path

__all__ = ["OLDEST", "InstalledMujoco", "installed_mujoco", "release_of"]

OLDEST = (3, 8, 1)
"""The oldest MuJoCo that the tests are run with."""

# Since 4.0.0, mujoco installs mujoco-core, which has the files; before, it had the files itself.
_OWNERS = ("mujoco", "mujoco-core")
_WHAT_IT_HAS = re.compile(r"\.(py|so|pyd|dll|dylib)(\.[\d.]+)?$")
_NOT_NEEDED = re.compile(r"_test\.py$|/(doc|experimental|include|sysid|testdata|usd)/")


@dataclass(frozen=True)
class InstalledMujoco:
    """MuJoCo as it is installed.

    Attributes
    ----------
    folder
        The folder that ``import mujoco`` would import; None if there is none.
    owners
        Names and versions of the packages that are installed into it.
    problem
        What is wrong with the files, as a clause; empty if nothing is.
    """

    folder: Path | None
    owners: dict[str, str]
    problem: str = ""

    @property
    def remedy(self) -> str:
        """How to mend it, as a sentence."""
        if self.folder is None:
            return "Install it: pip install mujoco"
        if not self.owners:
            return f"Delete {self.folder}, then install it: pip install mujoco"
        return (
            f"Uninstall all of it, then install one: pip uninstall -y {' '.join(_OWNERS)}; "
            "pip install mujoco"
        )


def installed_mujoco() -> InstalledMujoco:
    """Look at the installed MuJoCo, without importing it.

    ``mujoco`` and ``mujoco-core`` are installed into the same folder. Of two versions, each
    replaces files of the other, and uninstalling one takes the other's away; pip says nothing.

    Returns
    -------
    What is installed. A MuJoCo that no package manager has installed has no owners, and is not
    looked at further.
    """
    folder = _folder()
    if folder is None:
        return InstalledMujoco(None, {}, "MuJoCo is not installed")
    found = {
        name: package
        for name in _OWNERS
        for package in metadata.distributions(name=name, path=[str(folder.parent)])
    }
    owners = {name: package.version for name, package in found.items()}
    words = " and ".join(f"{name} {version}" for name, version in owners.items())
    if len({release_of(version) for version in owners.values()}) > 1:
        problem = (
            f"{words} are two versions of MuJoCo in one folder, {folder}; the one that came last "
            "replaced files of the other"
        )
        return InstalledMujoco(folder, owners, problem)
    missing = [path for package in found.values() for path in _missing(package)]
    if missing:
        more = f" and {len(missing) - 1} more" if len(missing) > 1 else ""
        problem = (
            f"of {words}, {missing[0].name}{more} is missing in {folder}; pip takes files away "
            "when it removes or upgrades another package that has them too"
        )
        return InstalledMujoco(folder, owners, problem)
    if not (folder / "__init__.py").is_file():
        return InstalledMujoco(folder, owners, f"{folder} is what is left of an uninstalled MuJoCo")
    return InstalledMujoco(folder, owners)


def _folder() -> Path | None:
    module = sys.modules.get("mujoco")
    spec = module.__spec__ if module is not None else find_spec("mujoco")
    places = list(spec.submodule_search_locations or []) if spec is not None else []
    return Path(places[0]) if places else None


def release_of(version: str) -> tuple[int, ...]:
    """Return the three numbers of a version, which all packages of one MuJoCo share."""
    return tuple(int(number) for number in re.findall(r"\d+", version)[:3])


def _missing(package: metadata.Distribution) -> list[Path]:
    """Return the files that MuJoCo needs, that a package has installed, and that are not there."""
    lines = (package.read_text("RECORD") or "").splitlines()
    names = [line.rsplit(",", 2)[0].strip('"') for line in lines]
    needed = [n for n in names if n.startswith("mujoco/") and _WHAT_IT_HAS.search(n)]
    paths = [Path(str(package.locate_file(n))) for n in needed if not _NOT_NEEDED.search(n)]
    return [path for path in paths if not path.exists()]
