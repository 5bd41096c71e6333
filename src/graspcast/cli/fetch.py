"""The verb ``fetch``: public data into the cache, checked."""

from __future__ import annotations

import argparse
import shlex
from typing import TYPE_CHECKING, Any

from graspcast.cli.console import note, print_table, print_text
from graspcast.cli.options import Verbs, add_json, new_verb, write_json
from graspcast.cli.progress import progress_bar
from graspcast.errors import InputError

if TYPE_CHECKING:
    from graspcast.fetching.catalogue import Item
    from graspcast.fetching.fetch import Fetched

__all__ = ["add"]

_NEXT = {
    "models": "graspcast errors --bop {path} --estimates NAME=FILE",
    "images": "graspcast estimate --bop {path} --detections FILE --estimator NAME --out FILE",
    "release": "graspcast import-release {path} data/published",
}


def add(verbs: Verbs) -> None:
    """Add the verb ``fetch``."""
    verb = new_verb(
        verbs,
        "fetch",
        _fetch,
        "download BOP models and images, or the authors' release, into the cache",
        "Download public data into the cache and print the path for --bop, or verify what is\n"
        "there: every file is compared with the digest of its first download. Interrupted\n"
        "downloads go on where they ended. Each licence is named before anything is downloaded,\n"
        "and downloading means accepting it. The cache is GRASPCAST_CACHE, or the platform's;\n"
        "proxies are taken from the environment (HTTPS_PROXY, NO_PROXY).",
    )
    verb.add_argument("items", metavar="ITEM", nargs="*", help="what to fetch; --list names all")
    verb.add_argument(
        "--list", action="store_true", help="list what can be fetched, its size, source and licence"
    )
    verb.add_argument(
        "--mirror",
        metavar="URL",
        help="https://…, http://…, file://… or a directory that holds the archives by their names, "
        "in place of their sources",
    )
    verb.add_argument(
        "--offline",
        action="store_true",
        default=None,
        help="download nothing: verify what is in the cache (also: GRASPCAST_OFFLINE=1)",
    )
    verb.add_argument(
        "--again",
        action="store_true",
        help="download anew, and accept files that differ from those fetched first",
    )
    add_json(verb)


def _fetch(options: argparse.Namespace) -> None:
    from graspcast.fetching.catalogue import item_named

    if options.list:
        if options.items:
            raise InputError(
                "what is listed is all that there is: no item is needed", parameters=("list",)
            )
        _list(options)
        return
    if not options.items:
        raise InputError("name what to fetch, for example lmo-models (see --list)")
    items = [item_named(name) for name in dict.fromkeys(options.items)]
    told = [_one(item, options) for item in items]
    write_json(options.json, {"items": told})


def _list(options: argparse.Namespace) -> None:
    from graspcast.fetching.catalogue import ITEMS
    from graspcast.fetching.disk import in_words
    from graspcast.fetching.store import Store

    store = Store()
    rows = [
        (
            item.name,
            item.holds,
            "about " + in_words(item.about_bytes),
            item.licence.name,
            item.licence.url,
            "yes" if all(store.receipt(a) is not None for a in item.archives) else "no",
        )
        for item in ITEMS.values()
    ]
    print_table(
        f"What can be fetched into {store.root}",
        ("item", "holds", "download", "licence", "source", "in cache"),
        rows,
    )
    names = ("item", "holds", "download", "licence", "source")
    items: list[dict[str, Any]] = [
        {
            **dict(zip(names, row, strict=False)),
            "in_cache": row[-1] == "yes",
            "about_bytes": ITEMS[row[0]].about_bytes,
            "path": str(store.folder(ITEMS[row[0]].archives[0])),
            "archives": [{"name": a.name, "url": a.url} for a in ITEMS[row[0]].archives],
        }
        for row in rows
    ]
    write_json(options.json, {"items": items})


def _one(item: Item, options: argparse.Namespace) -> dict[str, Any]:
    from graspcast.fetching.fetch import fetch

    licence = item.licence
    note(
        f"{item.name}: {item.holds}, under {licence.name} ({licence.url}); to download it is to "
        "accept this licence"
    )
    with progress_bar(f"fetching {item.name}") as move:
        fetched = fetch(
            item.name,
            mirror=options.mirror,
            offline=options.offline,
            again=options.again,
            progress=move,
        )
    return _told(fetched)


def _told(fetched: Fetched) -> dict[str, Any]:
    from graspcast.fetching.disk import in_words

    item = fetched.item
    for archive in fetched.archives:
        state = f"fetched from {archive.url}" if archive.new else "in the cache, verified"
        remarks = "".join(f"; {remark}" for remark in archive.remarks)
        note(f"{archive.name}: {archive.files} files, {in_words(archive.size)}, {state}{remarks}")
    print_text(str(fetched.path))
    kind = "release" if item.name == "release" else item.name.partition("-")[2] or "models"
    note("next: " + _NEXT[kind].format(path=shlex.quote(str(fetched.path))))
    return {
        "item": item.name,
        "path": str(fetched.path),
        "licence": item.licence.name,
        "archives": [
            {
                "name": a.name,
                "url": a.url,
                "sha256": a.sha256,
                "files": a.files,
                "bytes": a.size,
                "downloaded": a.new,
                "remarks": list(a.remarks),
            }
            for a in fetched.archives
        ],
    }
