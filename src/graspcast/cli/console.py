"""What the command line prints: tables on standard output, notes and progress on standard error."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Protocol

__all__ = ["note", "print_table", "print_text", "progress_bar"]


def print_text(text: str) -> None:
    """Plain text on standard output."""
    print(text)  # noqa: T201


def note(*texts: str) -> None:
    """Remarks on standard error, a line each, none twice."""
    from rich.console import Console

    console = Console(stderr=True, soft_wrap=True, highlight=False)
    for text in dict.fromkeys(texts):
        # Brackets are what they are: pip install 'graspcast[render]'.
        console.print(text, style="dim", markup=False)


def print_table(title: str, header: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """A table on standard output; all but the first column to the right."""
    from rich.console import Console
    from rich.table import Table

    table = Table()
    for i, name in enumerate(header):
        table.add_column(name, justify="left" if i == 0 else "right")
    for row in rows:
        table.add_row(*row)
    # Brackets are what they are: of intervals, for example.
    console = Console(markup=False)
    if not console.is_terminal:
        # A file or a pipe has no width; nothing is to be folded or cut off for one.
        console = Console(width=1000, markup=False)
    console.print(title, table, sep="\n")


class Move(Protocol):
    """Moves a progress bar."""

    def __call__(self, share: float, words: str = ...) -> None:
        """To a share from 0 to 1, perhaps with other words beside it."""
        ...


@contextmanager
def progress_bar(text: str) -> Iterator[Move]:
    """A progress bar on standard error, moved by calling with a share and perhaps a new text."""
    from rich.console import Console
    from rich.progress import Progress, TimeElapsedColumn, TimeRemainingColumn

    columns = (*Progress.get_default_columns()[:-1], TimeRemainingColumn(), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(text, total=1.0)

        def move(share: float, words: str = text) -> None:
            bar.update(task, completed=share, description=words)

        yield move
