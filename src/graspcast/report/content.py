"""Content of a report: sections with paragraphs, tables, figures and cases, before any HTML."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from markupsafe import Markup

from graspcast.report.csv_data import csv_text, data_uri
from graspcast.report.text import clean

__all__ = ["Case", "Cell", "Figure", "Missing", "Mode", "Picture", "Run", "Section", "Table"]


@dataclass(frozen=True)
class Cell:
    """A cell of a table: what is shown, the number it is sorted by, and its interval."""

    text: str
    value: float | None = None
    ends: tuple[float, float] | None = None

    @classmethod
    def of(cls, value: object, digits: int | None = None) -> Cell:
        """Return the cell of a number, with so many decimals, or of text; a dash for None."""
        if value is None or (isinstance(value, float) and value != value):
            return cls("-", None)
        if isinstance(value, bool):
            return cls("yes" if value else "no", float(value))
        if isinstance(value, int):
            return cls(f"{value:,}", float(value))
        if isinstance(value, float):
            return cls(f"{value:.{3 if digits is None else digits}f}", value)
        return cls(clean(value))


@dataclass(frozen=True)
class Table:
    """A table that sorts.

    Attributes
    ----------
    key
        For its file and its place in the page.
    caption
        What it shows, in one or two sentences.
    columns
        Names of the columns; those of numbers are aligned to the right.
    rows
        Cells.
    numeric
        Which columns hold numbers.
    data
        Columns and rows of the CSV behind it; its own cells if None.
    """

    key: str
    caption: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    numeric: tuple[bool, ...]
    data: tuple[tuple[str, ...], tuple[tuple[object, ...], ...]] | None = None

    @property
    def uri(self) -> str:
        """The CSV as a data: address."""
        return data_uri(csv_text(*(self.data or self._own_data())))

    def _own_data(self) -> tuple[list[str], list[list[object]]]:
        """Return the columns and rows of its cells, an interval's ends in columns of their own."""
        spread = [any(row[k].ends for row in self.rows) for k in range(len(self.columns))]
        columns: list[str] = []
        rows: list[list[object]] = [[] for _ in self.rows]
        for k, name in enumerate(self.columns):
            columns += [name, f"{name}, low", f"{name}, high"] if spread[k] else [name]
            for out, row in zip(rows, self.rows, strict=True):
                cell = row[k]
                empty = self.numeric[k] and cell.value is None
                out.append(None if empty else cell.text if cell.value is None else cell.value)
                out += (cell.ends or (None, None)) if spread[k] else ()
        return columns, rows


@dataclass(frozen=True)
class Figure:
    """A chart, with its data.

    Attributes
    ----------
    key
        For its file and its place in the page.
    title, caption
        Above and below it.
    svg
        The chart.
    columns, rows
        Its data.
    """

    key: str
    title: str
    caption: str
    svg: Markup
    columns: tuple[str, ...]
    rows: tuple[tuple[object, ...], ...]

    @property
    def uri(self) -> str:
        """The CSV as a data: address."""
        return data_uri(csv_text(self.columns, self.rows))


@dataclass(frozen=True)
class Picture:
    """A picture: the bytes of a WebP file, and words for those who do not see it."""

    name: str
    alt: str
    webp: bytes
    width: int
    height: int

    @property
    def uri(self) -> str:
        """The picture as a data: address."""
        return data_uri(self.webp, "image/webp")


@dataclass(frozen=True)
class Case:
    """One grasp to look at.

    Attributes
    ----------
    title
        Which object in which image.
    facts
        Names and values.
    pictures
        The estimate on its image, then the moments of the trial; may be empty.
    """

    title: str
    facts: tuple[tuple[str, str], ...]
    pictures: tuple[Picture, ...] = ()

    @property
    def bytes(self) -> int:
        """Bytes of all pictures, as the page holds them."""
        return sum(len(picture.uri) for picture in self.pictures)


@dataclass(frozen=True)
class Mode:
    """Cases of one kind.

    Attributes
    ----------
    key, title
        Of the kind.
    text
        What they have in common, and how they were chosen.
    cases
        The cases, the most telling first.
    of
        How many there are in all; 0 where that says nothing.
    """

    key: str
    title: str
    text: str
    cases: tuple[Case, ...]
    of: int


@dataclass(frozen=True)
class Missing:
    """Something that a report could show, and how to get it.

    Attributes
    ----------
    what
        What is missing, and why.
    command
        The command that makes it; empty where words say it.
    """

    what: str
    command: str = ""


@dataclass(frozen=True)
class Section:
    """A section of a run.

    Attributes
    ----------
    key, title
        Its place in the page, and its heading.
    paragraphs
        Text above everything.
    tables, figures, modes
        What it shows, in this order.
    code
        Lines of commands, shown as they are; empty for none.
    """

    key: str
    title: str
    paragraphs: tuple[str, ...] = ()
    tables: tuple[Table, ...] = ()
    figures: tuple[Figure, ...] = ()
    modes: tuple[Mode, ...] = ()
    code: str = ""

    @property
    def is_empty(self) -> bool:
        """Whether there is nothing to show."""
        return not (self.paragraphs or self.tables or self.figures or self.modes or self.code)


@dataclass(frozen=True)
class Run:
    """A run as a report shows it.

    Attributes
    ----------
    name
        Its heading.
    lead
        The main result, in one or two sentences.
    numbers
        Figures at the top: what, value, and what it is of.
    sections
        Those that have something to show.
    missing
        What it lacks.
    """

    name: str
    lead: str
    numbers: tuple[tuple[str, str, str], ...]
    sections: tuple[Section, ...]
    missing: tuple[Missing, ...] = field(default=())

    def with_cases(self, keep: Sequence[tuple[str, int]]) -> Run:
        """Return it with only the first pictures of each mode: so many cases, by the mode's key."""
        most = dict(keep)
        sections = []
        for section in self.sections:
            modes = tuple(
                replace(
                    mode,
                    cases=tuple(
                        case if i < most.get(mode.key, 0) else replace(case, pictures=())
                        for i, case in enumerate(mode.cases)
                    ),
                )
                for mode in section.modes
            )
            sections.append(replace(section, modes=modes))
        return replace(self, sections=tuple(sections))
