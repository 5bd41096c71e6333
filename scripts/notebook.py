"""Run the notebook, and write it with its outputs or check that it runs.

python scripts/notebook.py            # runs it; ends with 1 if a cell fails
python scripts/notebook.py --write    # also writes its outputs, which the site shows
"""

from __future__ import annotations

import sys
import time
from argparse import ArgumentParser
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import nbformat
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError

NOTEBOOK = Path(__file__).parents[1] / "notebooks" / "tour.ipynb"


def main() -> int:
    options = ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--write", action="store_true", help="keep the outputs")
    write = options.parse_args().write
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    began = time.monotonic()
    with TemporaryDirectory() as scratch:
        place = {"metadata": {"path": scratch}}
        client = NotebookClient(notebook, timeout=600, record_timing=False, resources=place)
        try:
            client.execute()
        except CellExecutionError as error:
            print(error)
            return 1
    count = sum(cell.cell_type == "code" for cell in notebook.cells)
    print(f"{NOTEBOOK.name}: {count} cells in {time.monotonic() - began:.0f} s")
    if write:
        for data in _pictures(notebook):
            # Pillow shows pictures in two formats; the smaller one is kept.
            del data[max(("image/jpeg", "image/png"), key=lambda kind: len(data[kind]))]
        nbformat.write(notebook, NOTEBOOK)
    return 0


def _pictures(notebook: nbformat.NotebookNode) -> Iterator[dict[str, str]]:
    """Yield the data of outputs that hold a picture twice."""
    for cell in notebook.cells:
        for output in cell.get("outputs", []):
            if {"image/jpeg", "image/png"} <= set(output.get("data", {})):
                yield output["data"]


if __name__ == "__main__":
    sys.exit(main())
