"""Tables as files: digests and damaged Parquet files."""

from __future__ import annotations

import gzip
import io
from pathlib import Path

import polars as pl
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from graspcast.errors import FormatError, InputError
from graspcast.io.hashing import sha256
from graspcast.io.tables import parquet_bytes, read_csv, read_parquet, write_table

FRAME = pl.DataFrame({"name": ["a", "b", None], "n": [1, 2, 3], "x": [0.5, None, float("inf")]})
ABORTS = Path(__file__).parents[1] / "data" / "parquet_that_aborts_polars.parquet"

frames = st.lists(st.tuples(st.text(max_size=5), st.integers(-9, 9)), max_size=20).map(
    lambda rows: pl.DataFrame(rows, schema={"t": pl.String, "n": pl.Int64}, orient="row")
)


@given(frames)
@settings(max_examples=30)
def test_a_table_comes_back_and_any_parquet_reader_takes_it(frame: pl.DataFrame) -> None:
    content = parquet_bytes(frame)
    assert pl.read_parquet(io.BytesIO(content)).equals(frame)
    assert parquet_bytes(frame) == content


@pytest.mark.parametrize("name", ["deep/er/t.parquet", "t.csv"])
def test_what_is_written_is_read_back(tmp_path: Path, name: str) -> None:
    write_table(tmp_path / name, FRAME)
    read = read_parquet if name.endswith("parquet") else read_csv
    assert read(tmp_path / name).equals(FRAME)


@settings(max_examples=200, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(place=st.integers(0, 10**6), value=st.integers(1, 255), cut=st.booleans())
def test_any_flipped_bit_or_missing_byte_of_ours_is_found(
    place: int, value: int, cut: bool, tmp_path: Path
) -> None:
    content = bytearray(parquet_bytes(FRAME))
    place %= len(content)
    content[place] ^= value
    path = tmp_path / "a.parquet"
    # Cut off before the footer it is no file of ours any more, and no Parquet.
    path.write_bytes(content[:place] if cut and place > len(content) - 8 else content)
    with pytest.raises(FormatError, match="is damaged"):
        read_parquet(path)


def test_a_file_that_makes_polars_abort_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match=r"is not a Parquet file \(memory allocation of 2305"):
        read_parquet(ABORTS)


@pytest.mark.slow
@settings(max_examples=10, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(place=st.integers(0, 10**6), value=st.integers(1, 255), cut=st.booleans())
@example(place=0, value=0, cut=False)
def test_damaged_files_of_others_are_read_or_refused(
    place: int, value: int, cut: bool, tmp_path: Path
) -> None:
    FRAME.write_parquet(tmp_path / "a.parquet")
    content = bytearray((tmp_path / "a.parquet").read_bytes())
    place %= len(content)
    content[place] ^= value
    (tmp_path / "a.parquet").write_bytes(content[:place] if cut else content)
    try:
        read_parquet(tmp_path / "a.parquet")
    except FormatError:
        assert value
    else:
        assert not cut


def test_other_people_s_parquet_is_read(tmp_path: Path) -> None:
    FRAME.write_parquet(tmp_path / "a.parquet")
    assert read_parquet(tmp_path / "a.parquet").equals(FRAME)


def test_a_child_does_not_import_from_the_working_directory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "polars.py").write_text("raise SystemExit('not the library')")
    monkeypatch.chdir(tmp_path)
    FRAME.write_parquet("a.parquet")
    assert len(read_parquet("a.parquet")) == 3


def test_a_parquet_file_that_takes_too_long_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("graspcast.io.tables._CHILD", "import time; time.sleep(60)")
    monkeypatch.setattr("graspcast.io.tables._CHILD_SECONDS", 0.2)
    FRAME.write_parquet(tmp_path / "a.parquet")
    with pytest.raises(FormatError, match=r"took longer than 0\.2 s"):
        read_parquet(tmp_path / "a.parquet")


def test_files_that_are_absent_or_something_else_are_named(tmp_path: Path) -> None:
    for read, ending in ((read_parquet, "parquet"), (read_csv, "csv")):
        with pytest.raises(FormatError, match=rf"a\.{ending}: cannot be read \(No such file"):
            read(tmp_path / f"a.{ending}")
        (tmp_path / f"b.{ending}").write_bytes(b"")
        with pytest.raises(FormatError, match=rf"b\.{ending}: is not a"):
            read(tmp_path / f"b.{ending}")
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written"):
        write_table(tmp_path / "file" / "t.parquet", FRAME)


def test_a_digest_alone_makes_no_table(tmp_path: Path) -> None:
    unset = b"graspcast:sha256 @" + b"0" * 64
    digest = sha256(unset).encode()
    (tmp_path / "a.parquet").write_bytes(unset.replace(b"0" * 64, digest))
    with pytest.raises(FormatError, match=r"a\.parquet: is not a Parquet file"):
        read_parquet(tmp_path / "a.parquet")


def test_a_csv_that_is_packed_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_bytes(gzip.compress(b"a,b\n1,2\n"))
    with pytest.raises(FormatError, match="gzip"):
        read_csv(tmp_path / "a.csv")


@pytest.mark.parametrize(("mark", "says"), [(";", "semicolons"), ("\t", "tabs")])
def test_other_separators_are_named(tmp_path: Path, mark: str, says: str) -> None:
    path = tmp_path / "a.csv"
    path.write_text(f"a{mark}b\n1{mark}0,5\n")
    with pytest.raises(FormatError, match=f"separated by {says}; separate them by commas"):
        read_csv(path)
    path.write_text(f'a,"b{mark}"\n1,2\n')
    assert read_csv(path).shape == (1, 2)


def test_a_csv_in_utf_16_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_bytes("a,b\n1,2\n".encode("utf-16"))
    with pytest.raises(FormatError, match="UTF-16; save it as UTF-8"):
        read_csv(tmp_path / "a.csv")
