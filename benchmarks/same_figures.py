"""Do two JSON files hold the same figures? For a change that should not change any.

    python benchmarks/same_figures.py before.json after.json --rename value=net_benefit

Compares every number and text of the first file with the second, after renaming keys, and prints
each difference. Exit code 1 if there is one.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any


def leaves(content: Any, names: Mapping[str, str], path: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the path and value of every figure, with keys renamed."""
    if isinstance(content, dict):
        for key, value in content.items():
            yield from leaves(value, names, f"{path}/{names.get(key, key)}")
    elif isinstance(content, list):
        for i, value in enumerate(content):
            yield from leaves(value, names, f"{path}/{i}")
    else:
        yield path, content


def same(one: Any, other: Any, tolerance: float) -> bool:
    if isinstance(one, float) or isinstance(other, float):
        if one is None or other is None:
            return one is other
        return math.isclose(one, other, rel_tol=tolerance, abs_tol=tolerance)
    return bool(one == other)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("before", type=Path)
    parser.add_argument("after", type=Path)
    parser.add_argument("--rename", metavar="OLD=NEW", action="append", default=[])
    parser.add_argument("--tolerance", type=float, default=0.0, help="default: 0, the same bits")
    parser.add_argument("--ignore", metavar="TEXT", action="append", default=[], help="in paths")
    options = parser.parse_args()
    names = dict(text.split("=", 1) for text in options.rename)
    before = dict(leaves(json.loads(options.before.read_text()), names))
    after = dict(leaves(json.loads(options.after.read_text()), {}))
    wanted = [p for p in {**before, **after} if not any(text in p for text in options.ignore)]
    differing = 0
    for path in wanted:
        if path not in before or path not in after:
            print(f"{path}: only {'after' if path in after else 'before'}")
        elif not same(before[path], after[path], options.tolerance):
            print(f"{path}: {before[path]} before, {after[path]} after")
        else:
            continue
        differing += 1
    print(f"{len(wanted)} figures, {differing} differ")
    return 1 if differing else 0


if __name__ == "__main__":
    sys.exit(main())
