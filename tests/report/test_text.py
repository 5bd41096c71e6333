"""Text that a page can show."""

from __future__ import annotations

import numpy as np

from graspcast.evaluation.bootstrap import Interval
from graspcast.report.text import clean, rate, shortened, spread


def test_what_cannot_be_shown_is_replaced() -> None:
    assert clean("a\x00b\x1b\u202ec\u2066") == "a\ufffdb\ufffd\ufffdc\ufffd"
    assert clean("tab\tline\n抓取 <b>") == "tab\tline\n抓取 <b>"
    assert clean("\udcff.csv") == "?.csv"
    assert clean(3) == "3"


def test_long_text_lacks_its_middle() -> None:
    assert shortened("short") == "short"
    cut = shortened("a" * 50 + "b" * 50, 20)
    assert len(cut) == 20 and cut.startswith("aaa") and cut.endswith("bbb") and "…" in cut


def test_numbers() -> None:
    assert rate(None) == rate(float("nan")) == "-" and rate(0.12345) == "0.123"
    assert spread(None) == spread(Interval(0.5, np.nan, np.nan)) == ""
    assert spread(Interval(0.5, 0.25, 0.75)) == "[0.250, 0.750]"
