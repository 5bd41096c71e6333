"""Numbers as text."""

from __future__ import annotations

import pytest

from graspcast.io.numerals import plain


@pytest.mark.parametrize("cell", ["10", " 1e-3 ", "[1, 2]", 10, 0.5, None])
def test_what_files_write_is_returned(cell: object) -> None:
    assert plain(cell) is cell


@pytest.mark.parametrize("cell", ["1_0", "\u0661\u0660", "1\u00a0000", "0.5\u2212"])
def test_what_only_python_takes_for_a_number_is_refused(cell: str) -> None:
    with pytest.raises(ValueError, match="is no number"):
        plain(cell)
