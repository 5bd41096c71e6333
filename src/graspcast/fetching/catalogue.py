"""Catalogue of what can be fetched: archives, where they come from, and their licences.

The archives of LM-O and YCB-V are those of the BOP project, which keeps them in its organisation on
Hugging Face. The authors' release is a commit of their repository on GitHub.
"""

from __future__ import annotations

from dataclasses import dataclass

from graspcast.errors import UnknownNameError

__all__ = ["ITEMS", "Archive", "Item", "Licence", "item_named"]

_BOP = "https://huggingface.co/datasets/bop-benchmark"
_RELEASE = "https://github.com/EricCJoyce/Consensus-Driven-Uncertainty"
_COMMIT = "a3c6676dd2226701cb4096897de0f303e46957e5"


@dataclass(frozen=True)
class Licence:
    """A licence.

    Attributes
    ----------
    name
        Its name.
    url
        Where what it covers, and the licence, are described.
    """

    name: str
    url: str


@dataclass(frozen=True)
class Archive:
    """An archive that is downloaded and unpacked.

    Attributes
    ----------
    name
        File name, ending in ``.zip`` or ``.tar.gz``.
    url
        Address.
    folder
        Folder of the cache into which it is unpacked.
    root
        A first folder that is left out where all members have it; ``"*"`` for any.
    takes
        Patterns of the files and folders that are unpacked, at the top; others are left out.
    needs
        A file or folder without which it is not what was expected.
    about_bytes
        Approximate size of the archive, from public records.
    licence
        Its licence.
    git_tree
        SHA-1 of the git tree that it must hold, if known.
    """

    name: str
    url: str
    folder: str
    root: str
    takes: tuple[str, ...]
    needs: str
    about_bytes: int
    licence: Licence
    git_tree: str | None = None


@dataclass(frozen=True)
class Item:
    """Something that can be fetched by its name.

    Attributes
    ----------
    name, holds
        Name, and what it is.
    archives
        Its archives, all unpacked into one folder.
    """

    name: str
    holds: str
    archives: tuple[Archive, ...]

    @property
    def about_bytes(self) -> int:
        """Approximate size of the archives together."""
        return sum(archive.about_bytes for archive in self.archives)

    @property
    def licence(self) -> Licence:
        """The licence of all archives."""
        return self.archives[0].licence


def _bop(
    dataset: str, archive: str, takes: tuple[str, ...], needs: str, about: int, licence: str
) -> Archive:
    name = f"{dataset}_{archive}.zip"
    return Archive(
        name=name,
        url=f"{_BOP}/{dataset}/resolve/main/{name}",
        folder=dataset,
        root=dataset,
        takes=takes,
        needs=needs,
        about_bytes=about,
        licence=Licence(licence, f"{_BOP}/{dataset}"),
    )


def _items(title: str, dataset: str, sizes: tuple[int, int, int], licence: str) -> list[Item]:
    """Return the items of a BOP dataset; ``sizes`` of its base, models and images."""
    base = _bop(
        dataset, "base", ("camera*.json", "dataset_info.*", "test_targets_*.json"),
        "test_targets_bop19.json", sizes[0], licence,
    )  # fmt: skip
    models = _bop(dataset, "models", ("models*",), "models/models_info.json", sizes[1], licence)
    images = _bop(dataset, "test_bop19", ("test",), "test", sizes[2], licence)
    return [
        Item(f"{dataset}-models", f"object models of {title}", (base, models)),
        Item(
            f"{dataset}-images", f"test images of {title}, as of BOP 2019 to 2024", (base, images)
        ),
        Item(dataset, f"models and test images of {title}", (base, models, images)),
    ]


_RELEASED = Archive(
    name=f"Consensus-Driven-Uncertainty-{_COMMIT}.tar.gz",
    url=f"{_RELEASE}/archive/{_COMMIT}.tar.gz",
    folder="release",
    root="*",
    takes=("*",),
    needs="Pose-Estimates",
    about_bytes=17_000_000,
    licence=Licence("GPL-3.0", _RELEASE),
    git_tree="697bdcc5935e808d33caad160182693740fe021c",
)

ITEMS: dict[str, Item] = {
    item.name: item
    for item in [
        Item("release", "the release of the paper's authors", (_RELEASED,)),
        *_items("LM-O", "lmo", (5_684, 5_367_178, 117_550_985), "CC BY-SA 4.0"),
        *_items("YCB-V", "ycbv", (15_800, 524_000_000, 660_000_000), "MIT"),
    ]
}
"""What can be fetched, by name."""


def item_named(name: str) -> Item:
    """Return an item of the catalogue.

    Raises
    ------
    UnknownNameError
        If there is none of this name.
    """
    if name not in ITEMS:
        raise UnknownNameError("item", name, ITEMS, parameters=("items",))
    return ITEMS[name]
