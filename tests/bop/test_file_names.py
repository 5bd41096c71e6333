"""Names of results files, and the datasets that they state."""

from __future__ import annotations

from pathlib import Path

import pytest

from graspcast.bop.file_names import belongs_to, datasets_in, swapped_names
from graspcast.errors import InputError, MismatchError

UUID = "_7c9f443f-b900-41bb-af01-09b8eddfc2c4"


@pytest.mark.parametrize(
    ("name", "datasets"),
    [
        ("a/epos_lmo-test.csv", ("lmo",)),
        # The four forms of the BOP Challenge.
        ("m_kit-test-primesense.csv", ("kit",)),
        (f"m_kit-test{UUID}.csv", ("kit",)),
        (f"m_kit-test-primesense{UUID}.csv", ("kit",)),
        (f"m_kit-test-primesense{UUID}.csv.gz", ("kit",)),
        ("m_kit-test.json.gz", ("kit",)),
        # Whatever the ID is.
        ("cosy_kit-test_my-run.csv", ("kit",)),
        ("m_kit-val_run_3.csv", ("kit",)),
        # Methods and datasets with hyphens and underscores.
        ("gdrnpp-pbr_ycbv-test_primesense.csv", ("ycbv",)),
        ("my-test-net_lmo-test.csv", ("lmo",)),
        ("m_ycbv-classic-test.csv", ("ycbv-classic",)),
        ("m_my_parts-test.csv", ("parts", "my_parts")),
        ("x_lmo-test_ycbv-test.csv", ("lmo", "ycbv")),
        # Splits of other names.
        ("epos_lmo-mysplit.csv", ("lmo",)),
        ("results_my-run.csv", ("my",)),
        # No method.
        ("bin-test.csv", ("bin",)),
        # No dataset.
        ("results.csv", ()),
        ("run_2024-05-01.csv", ()),
        (f"results{UUID}.csv", ()),
    ],
)
def test_the_datasets_that_a_name_may_state(name: str, datasets: tuple[str, ...]) -> None:
    assert datasets_in(name) == datasets


@pytest.mark.parametrize(
    ("name", "given", "dataset"),
    [
        (f"m_kit-test{UUID}.csv", ["bin", "kit"], "kit"),
        ("m_my_parts-test.csv", ["my_parts"], "my_parts"),
        ("my_parts-test.csv", ["my_parts"], "my_parts"),
        (f"m_tless_v2-test-primesense{UUID}.csv", ["tless_v2"], "tless_v2"),
        ("gdrnpp_v2_ycbv-test.csv", ["ycbv"], "ycbv"),
        ("x_lmo-test_ycbv-test.csv", ["ycbv"], "ycbv"),
        ("m_YCBV-test.csv", ["ycbv"], "ycbv"),
        ("m_kit-test.csv", [], "kit"),
    ],
)
def test_a_given_dataset_decides(name: str, given: list[str], dataset: str) -> None:
    assert belongs_to(name, given) == (dataset, True)


@pytest.mark.parametrize(
    ("name", "given"),
    [
        (f"m_bin-test{UUID}.csv", ["kit"]),
        ("m_bin-test.csv", ["kit"]),
        ("bin-test.csv", ["kit"]),
        ("m_bin-test_kit-run.csv", ["kit"]),
        ("m_ycbv-classic-test.csv", ["ycbv"]),
        ("m_my_parts-test.csv", ["part", "my"]),
        ("m-kit_bin-test.csv", ["kit"]),
    ],
)
def test_a_name_of_another_dataset_is_refused(name: str, given: list[str]) -> None:
    with pytest.raises(MismatchError, match="by its name a CSV of dataset") as caught:
        belongs_to(name, given)
    # The advice works.
    advised = str(caught.value).rpartition("name it so: ")[2].removesuffix("=DIR")
    assert belongs_to(name, [advised]) == (advised, True)


def test_what_no_name_decides_is_asked() -> None:
    with pytest.raises(InputError, match=r"of which dataset.*dataset parts or my_parts"):
        belongs_to("m_my_parts-test.csv", [])
    with pytest.raises(InputError, match="parts or my_parts, and there are BOP directories"):
        belongs_to("m_my_parts-test.csv", ["parts", "my_parts"])
    with pytest.raises(
        InputError, match=r"of which dataset, kit or bin\? Name the file METHOD_DATASET-SPLIT"
    ):
        belongs_to("results.csv", ["kit", "bin"])
    with pytest.raises(InputError, match="of which dataset"):
        belongs_to("results.csv", [])
    assert belongs_to("results.csv", ["kit"]) == ("kit", False)


def test_a_file_named_after_another_estimator_is_told() -> None:
    a, b = Path("a_kit-test.csv"), Path("b_kit-test.csv")
    assert swapped_names([("a", a), ("b", b), ("c", Path("best_kit-test.csv"))]) == []
    assert swapped_names([("a", Path("b.csv")), ("b", b)]) == [], "that states no method"
    assert swapped_names([("a", b), ("b", a)]) == [
        "Warning: b_kit-test.csv, named after b, is given as estimates by a",
        "Warning: a_kit-test.csv, named after a, is given as estimates by b",
    ]
