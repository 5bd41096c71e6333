"""The catalogue: addresses, names and licences that belong together."""

from __future__ import annotations

import re
from urllib.parse import urlsplit

from graspcast.fetching.catalogue import ITEMS, item_named


def test_archives_have_an_address_and_a_licence() -> None:
    for item in ITEMS.values():
        assert item.about_bytes > 0
        assert len({archive.folder for archive in item.archives}) == 1
        assert len({archive.licence for archive in item.archives}) == 1
        for archive in item.archives:
            assert urlsplit(archive.url).scheme == "https"
            assert archive.name.endswith((".zip", ".tar.gz"))


def test_bop_archives_have_the_names_of_the_bop_project() -> None:
    names = {archive.name for archive in ITEMS["lmo"].archives}
    assert names == {"lmo_base.zip", "lmo_models.zip", "lmo_test_bop19.zip"}
    for archive in ITEMS["ycbv"].archives:
        assert archive.url.endswith(f"/bop-benchmark/ycbv/resolve/main/{archive.name}")


def test_the_release_is_one_commit() -> None:
    (archive,) = item_named("release").archives
    commit = re.search(r"[0-9a-f]{40}", archive.url)
    assert commit is not None
    assert commit[0] in archive.name
    assert archive.git_tree is not None


def test_archives_of_one_folder_do_not_hold_the_same() -> None:
    for item in ITEMS.values():
        takes = [pattern for archive in item.archives for pattern in archive.takes]
        assert len(takes) == len(set(takes))
