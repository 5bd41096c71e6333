"""Output of the command line: tables on standard output, notes on standard error."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager

__all__ = ["logged_as_notes", "note", "print_table", "print_text"]


def print_text(text: str) -> None:
    """Print text to standard output."""
    print(text)  # noqa: T201


def note(*texts: str) -> None:
    """Print remarks to standard error, one line each, without duplicates."""
    from rich.console import Console

    console = Console(stderr=True, soft_wrap=True, highlight=False)
    for text in dict.fromkeys(texts):
        # No markup: texts may hold brackets, as in pip install 'graspcast[render]'.
        console.print(text, style="dim", markup=False)


class _Notes(logging.Handler):
    """Prints each warning as a note, once."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self._told: set[str] = set()

    def emit(self, record: logging.LogRecord) -> None:
        """Print a record."""
        text = record.getMessage()
        if text not in self._told:
            self._told.add(text)
            note(text)


@contextmanager
def logged_as_notes() -> Iterator[None]:
    """Print the warnings that graspcast logs as notes."""
    logger, handler = logging.getLogger("graspcast"), _Notes()
    logger.addHandler(handler)
    try:
        yield
    finally:
        logger.removeHandler(handler)


def print_table(title: str, header: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Print a table to standard output, the first column aligned left, the others right."""
    from rich.console import Console
    from rich.table import Table

    table = Table()
    for i, name in enumerate(header):
        table.add_column(name, justify="left" if i == 0 else "right")
    for row in rows:
        table.add_row(*row)

    class OrBroken(Console):
        """A console that leaves a pipe that nobody reads to the caller."""

        def on_broken_pipe(self) -> None:
            raise BrokenPipeError

    # No markup: cells may hold brackets, of intervals for example.
    console = OrBroken(markup=False)
    if not console.is_terminal:
        # Files and pipes have no width: no line is folded or cut off.
        console = OrBroken(width=1000, markup=False)
    console.print(title, table, sep="\n")
