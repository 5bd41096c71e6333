"""Build sdist and wheel into a directory, and look at what is in them.

python scripts/build.py [--out dist]

The sdist is built from the checkout, and the wheel from the sdist, as installers do. twine checks
both, and their contents, sizes and the text of the package page are checked. It is refused to build
beside older files.
"""

from __future__ import annotations

import argparse
import email
import re
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
MIB = 1 << 20
LIMITS = {"whl": 16 * MIB, "gz": 20 * MIB}
ALWAYS = ("LICENSE", "NOTICE", "LICENSES/CC-BY-4.0.txt")
# What a wheel holds besides Python; anything else is there by mistake.
IN_WHEEL = re.compile(
    r"graspcast/(.+\.py|py\.typed|demo_data/.+|perception/weights/\w+\.onnx"
    r"|forecasting/models/mlp/README\.md|paper/paper_tables\.json|simulation/\w+/\w+\.toml"
    r"|report/templates/\w+\.(css|html|js))"
)
IN_SDIST = re.compile(
    r"(src|docs|ros|LICENSES)/.+|README\.md|CHANGELOG\.md|CITATION\.cff|LICENSE|NOTICE|PKG-INFO"
    r"|pyproject\.toml|\.gitignore"
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=ROOT / "dist", help="default: dist")
    out = parser.parse_args().out.resolve()
    if out.exists() and any(out.iterdir()):
        sys.exit(f"{out}: is not empty; delete it, or choose another directory")
    run = [sys.executable, "-m"]
    subprocess.run([*run, "build", "--outdir", str(out), str(ROOT)], check=True)
    files = sorted(path for path in out.iterdir() if path.suffix in (".whl", ".gz"))
    subprocess.run([*run, "twine", "check", "--strict", *map(str, files)], check=True)
    problems = [problem for path in files for problem in contents_problems(path)]
    problems += page_problems(described(next(path for path in files if path.suffix == ".whl")))
    if problems:
        sys.exit("\n".join(problems))


def described(wheel: Path) -> str:
    """Return the text of a wheel's package page."""
    with zipfile.ZipFile(wheel) as archive:
        (name,) = (n for n in archive.namelist() if n.endswith(".dist-info/METADATA"))
        return email.message_from_bytes(archive.read(name)).get_payload()


def page_problems(page: str) -> list[str]:
    """Return what does not work on a package page: links into the repository, commands of it."""
    links = re.findall(r"\]\((?!https?://)([^)]*)\)", page)
    problems = [f"package page: {link} leads nowhere there" for link in links]
    if "pip install -e" in page:
        problems.append("package page: pip install -e needs a checkout")
    if "pip install graspcast && graspcast demo" not in page:
        problems.append("package page: does not say how to install it and run the demonstration")
    return problems


def contents_problems(path: Path) -> list[str]:
    """Return what is wrong with the contents of an sdist or wheel."""
    kind = path.suffix[1:]
    if kind == "whl":
        with zipfile.ZipFile(path) as archive:
            names = [name for name in archive.namelist() if not name.endswith("/")]
        about = [name for name in names if ".dist-info/" in name]
        inside = [name for name in names if name not in about]
        licences = {name.partition("/licenses/")[2] for name in about}
        allowed = IN_WHEEL
    else:
        with tarfile.open(path) as archive:
            members = [member for member in archive.getmembers() if member.isfile()]
        inside = [member.name.partition("/")[2] for member in members]
        licences, allowed = set(inside), IN_SDIST
    problems = [f"{name} does not belong in it" for name in inside if not allowed.fullmatch(name)]
    problems += [f"{name} is missing" for name in ALWAYS if name not in licences]
    problems += [f"{name} is compiled code" for name in inside if name.endswith((".pyc", ".nbi"))]
    wanted = "graspcast/demo_data/ycbv/models/obj_000002.ply"
    if not any(name.endswith(wanted) for name in inside):
        problems.append(f"{wanted} is missing")
    size = path.stat().st_size
    if size > LIMITS[kind]:
        problems.append(f"its {size / MIB:.1f} MiB are more than {LIMITS[kind] / MIB:.0f}")
    print(f"{path.name}: {len(inside)} files, {size / MIB:.1f} MiB")
    return [f"{path.name}: {problem}" for problem in problems]


if __name__ == "__main__":
    main()
