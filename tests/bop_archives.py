"""Small archives of the names and layout of the BOP project's, and hostile ones."""

from __future__ import annotations

import io
import tarfile
import zipfile
from pathlib import Path

BASE = {"lmo/camera.json": b"{}", "lmo/test_targets_bop19.json": b"[]"}
MODELS = {"models/models_info.json": b"{}", "models/obj_000001.ply": b"ply\n" * 500}
IMAGES = {"test/000002/rgb/000003.png": bytes(range(256)) * 40}


def zipped(files: dict[str, bytes], *, pack: int = zipfile.ZIP_STORED) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", pack) as archive:
        for name, content in files.items():
            archive.writestr(zipfile.ZipInfo(name, (2024, 1, 1, 0, 0, 0)), content, pack)
    return out.getvalue()


def tarred(*members: tarfile.TarInfo | tuple[str, bytes]) -> bytes:
    out = io.BytesIO()
    with tarfile.open(fileobj=out, mode="w:gz") as archive:
        for member in members:
            if isinstance(member, tarfile.TarInfo):
                archive.addfile(member)
            else:
                info = tarfile.TarInfo(member[0])
                info.size = len(member[1])
                archive.addfile(info, io.BytesIO(member[1]))
    return out.getvalue()


def mirror(folder: Path, **changed: bytes) -> Path:
    """A directory with LM-O's archives; ``changed`` by what they hold: base, models, images."""
    folder.mkdir(parents=True, exist_ok=True)
    contents = {"base": zipped(BASE), "models": zipped(MODELS), "images": zipped(IMAGES)}
    contents.update(changed)
    names = {"base": "lmo_base.zip", "models": "lmo_models.zip", "images": "lmo_test_bop19.zip"}
    for key, content in contents.items():
        (folder / names[key]).write_bytes(content)
    return folder
