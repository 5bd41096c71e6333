"""Every variant of file that is read: how to make one, and what it should give.

``tests/test_file_variants.py`` reads each of them. ``python tests/file_variants.py`` writes the
tables of ``docs/your-files.md`` from files that it makes.
"""

from __future__ import annotations

import gzip
import itertools
import json
import re
import struct
import sys
import tempfile
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import partial
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from bop_images import FOCAL, SIZE, write_dataset
from graspcast.bop.pose_rows import Stated
from graspcast.bop.results import Results, write_results
from pose_files import megapose_entries, sam6d_entries, write_json, write_matrices
from poses import results_of, write_models
from scene_files import name_sensor

RESULTS, DETECTIONS, DATASETS = "Estimates", "Detections", "BOP directories"
IMAGES, MODELS, NAMES = "Images", "Models", "Names of results files"

DOCS = Path(__file__).parents[1] / "docs" / "your-files.md"
BEGIN, END = "<!-- written by tests/file_variants.py -->", "<!-- until here -->"
_WIDTH = 96

Make = Callable[[Path], Path]


@dataclass(frozen=True)
class Variant:
    """One variant.

    Attributes
    ----------
    kind
        What it is a variant of; the heading of its table.
    what, whose
        The variant in words, and whose files are so.
    make
        Writes it into an empty folder, and returns what is read.
    show
        What the table shows of it: ``"line N"``, from 1, a glob of paths, or text.
    given
        What is stated when it is read.
    """

    kind: str
    what: str
    whose: str
    make: Make
    show: str = "line 1"
    given: Mapping[str, Any] = field(default_factory=dict)


# --- Estimates ------------------------------------------------------------------------------------


def poses(scene_id: int = 2) -> Results:
    """Two poses of object 5 in images 0 and 1, with numbers of few digits."""
    from graspcast.pose.transforms import rotation_from_vector, transform

    turn = np.round(rotation_from_vector(np.array([[0, 0, np.pi / 2], [np.pi, 0, 0]])), 6)
    return results_of(
        transform(turn, np.array([[0.01, -0.02, 0.9], [0.03, 0.0, 0.8]])),
        obj_id=5,
        scene_id=scene_id,
    )


def csv_of(change: Callable[[str], str], folder: Path, name: str = "m_kit-test.csv") -> Path:
    path = folder / name
    write_results(path, poses())
    text = path.read_text().replace(".0 ", " ").replace(".0,", ",")
    path.write_text(change(text))
    return path


def _rows(change: Callable[[list[str]], Iterable[str]]) -> Callable[[str], str]:
    """Change the fields of each row, and leave out the header."""

    def of(text: str) -> str:
        lines = [line.split(",") for line in text.splitlines()[1:]]
        return "".join(",".join(change(fields)) + "\n" for fields in lines)

    return of


def _with_header(change: Callable[[list[str]], Iterable[str]]) -> Callable[[str], str]:
    return lambda text: text.partition("\n")[0] + "\n" + _rows(change)(text)


def _nested(numbers: str, mark: str = ", ") -> str:
    parts = numbers.split()
    if len(parts) == 3:
        return f"[{mark.join(parts)}]"
    return f"[{mark.join(_nested(' '.join(parts[i : i + 3]), mark) for i in (0, 3, 6))}]"


def packed(folder: Path) -> Path:
    path = csv_of(str, folder)
    out = path.with_name(path.name + ".gz")
    out.write_bytes(gzip.compress(path.read_bytes(), mtime=0))
    path.unlink()
    return out


def _sam6d(folder: Path, **changes: Any) -> Path:
    entries = sam6d_entries(poses())
    return write_json(folder / "detection_pem.json", [{**e, **changes} for e in entries])


def _megapose(folder: Path) -> Path:
    results = poses().select(np.array([0]))
    return write_json(folder / "object_data.json", megapose_entries(results, "mug"))


_LINE_2 = "line 2"
_ESTIMATES = [
    Variant(RESULTS, "the format of the BOP Challenge", "all", partial(csv_of, str), _LINE_2),
    Variant(RESULTS, "no header", "SAM-6D", partial(csv_of, _rows(lambda f: f))),
    Variant(
        RESULTS, "no time", "", partial(csv_of, lambda t: re.sub(r",[^,\n]*\n", "\n", t)), _LINE_2
    ),
    Variant(
        RESULTS,
        "time that is nan, negative, empty or a word",
        "methods that do not measure it",
        partial(csv_of, _with_header(lambda f: [*f[:6], "nan"])),
        _LINE_2,
    ),
    Variant(RESULTS, "gzip", "", packed, "*.csv.gz"),
    Variant(
        RESULTS,
        "brackets around R and t",
        "NumPy's text",
        partial(csv_of, _with_header(lambda f: [*f[:4], f"[{f[4]}]", f"[{f[5]}]", f[6]])),
        _LINE_2,
    ),
    Variant(
        RESULTS,
        "lists in quotes",
        "pandas",
        partial(
            csv_of,
            _with_header(lambda f: [*f[:4], f'"{_nested(f[4])}"', f'"{_nested(f[5])}"', f[6]]),
        ),
        _LINE_2,
    ),
    Variant(
        RESULTS,
        "commas between all numbers: 17 or, without a time, 16 columns",
        "",
        partial(csv_of, _rows(lambda f: ",".join(f).replace(" ", ",").split(","))),
    ),
    Variant(
        RESULTS,
        "semicolons or tabs between columns",
        "spreadsheets",
        partial(csv_of, lambda t: t.replace(",", ";")),
        _LINE_2,
    ),
    Variant(RESULTS, "JSON with R and t (mm)", "SAM-6D", _sam6d),
    Variant(
        RESULTS,
        "the same of one image that it does not know",
        "SAM-6D's demo",
        lambda folder: write_json(
            folder / "detection_pem.json",
            [{**sam6d_entries(poses())[0], "scene_id": 0, "image_id": 0, "category_id": 1}],
        ),
        given={"stated": Stated(2, 0, {"": 5})},
    ),
    Variant(
        RESULTS,
        "`object_data.json`: quaternion x, y, z, w and position (m)",
        "MegaPose, happypose",
        _megapose,
        given={"stated": Stated(2, 0, {"mug": 5})},
    ),
    Variant(
        RESULTS,
        "a directory of 4x4 matrices (m), named after the images",
        "FoundationPose",
        lambda folder: write_matrices(folder / "ob_in_cam", poses()),
        "ob_in_cam/*",
        given={"stated": Stated(2, None, {"": 5})},
    ),
]

# --- Names ----------------------------------------------------------------------------------------

_UUID = "_7c9f443f-b900-41bb-af01-09b8eddfc2c4"
_FORMS = [
    ("METHOD_DATASET-SPLIT", "epos_lmo-test.csv", "lmo", "test"),
    ("… with an ID", f"cnos_icbin-test{_UUID}.csv", "icbin", "test"),
    ("… with a type of split", "m_tless-test-primesense.csv", "tless", "test_primesense"),
    ("… with both", f"m_hb-val-primesense{_UUID}.csv", "hb", "val_primesense"),
    ("any ID", "cosy_kit-test_my-run.csv", "kit", "test"),
    ("hyphens in the method and the dataset", "a-b_ycbv-classic-test.csv", "ycbv-classic", "test"),
    ("underscores in the dataset", "m_my_parts-val.csv", "my_parts", "val"),
    ("compressed", "epos_lmo-test.csv.gz", "lmo", "test"),
]


def _named(name: str, folder: Path) -> Path:
    return folder / name


_NAMES = [
    Variant(
        NAMES,
        what,
        "BOP Challenge" if i < 4 else "",
        partial(_named, name),
        name,
        {"dataset": dataset, "split": split},
    )
    for i, (what, name, dataset, split) in enumerate(_FORMS)
]

# --- Detections -----------------------------------------------------------------------------------

BOXES = ((1, 3, 1, [10, 20, 30, 20]), (1, 8, 5, [40, 10, 20, 30]))


def _detections(folder: Path, content: Any, name: str = "detections.json") -> Path:
    path = folder / name
    text = json.dumps(content)
    if name.endswith(".gz"):
        path.write_bytes(gzip.compress(text.encode(), mtime=0))
    else:
        path.write_text(text)
    return path


_BOP = [
    {"scene_id": s, "image_id": i, "category_id": o, "score": 1.0, "bbox": b}
    for s, i, o, b in BOXES
]
_BY_IMAGE = {f"{s}/{i}": [{"obj_id": o, "score": 1.0, "bbox_est": b}] for s, i, o, b in BOXES}
_COCO = {
    "annotations": [
        {"image_id": i, "category_id": o, "bbox": b, "iscrowd": 0} for _, i, o, b in BOXES
    ],
    "images": [{"id": i, "file_name": f"{s:06d}/rgb/{i:06d}.png"} for s, i, _, _ in BOXES],
}


def boxes_by_image() -> dict[str, Any]:
    """Boxes as GDRNPP and ZebraPose keep them."""
    return _BY_IMAGE


def boxes_of_coco() -> dict[str, Any]:
    """Boxes as COCO keeps them."""
    return _COCO


_DETECTIONS = [
    Variant(
        DETECTIONS, "the format of the BOP Challenge", "all", partial(_detections, content=_BOP)
    ),
    Variant(
        DETECTIONS,
        "gzip",
        "BOP Challenge's default detections",
        partial(_detections, content=_BOP, name="detections.json.gz"),
        "*.json.gz",
    ),
    Variant(
        DETECTIONS,
        "boxes by image",
        "GDRNPP, ZebraPose",
        partial(_detections, content=_BY_IMAGE),
    ),
    Variant(
        DETECTIONS,
        "images and annotations",
        "COCO, `scene_gt_coco.json`",
        partial(_detections, content=_COCO),
    ),
]

# --- BOP directories ------------------------------------------------------------------------------


def _dataset(change: Callable[[Path], Any], folder: Path) -> Path:
    root = write_dataset(folder / "kit").root
    change(root)
    return root


def _rename(root: Path, **names: str) -> None:
    for old, new in names.items():
        path = root / old if (root / old).exists() else root / f"{old}.json"
        path.rename(path.with_name(new))


def _edit(root: Path, pattern: str, change: Callable[[Any], Any]) -> None:
    for path in root.glob(pattern):
        path.write_text(json.dumps(change(json.loads(path.read_text()))))


def _of_each(keep: Callable[[dict[str, Any]], dict[str, Any]]) -> Callable[[Any], Any]:
    return lambda images: {k: [keep(entry) for entry in v] for k, v in images.items()}


def _several_cameras(root: Path) -> None:
    name_sensor(root / "test", "cam1")
    for scene in (root / "test").iterdir():
        (scene / "scene_gt_photoneo.json").write_text("{}")


def _grey(root: Path, folder: str = "gray") -> None:
    for scene in (root / "test").iterdir():
        for path in list((scene / "rgb").iterdir()):
            with Image.open(path) as image:
                image.convert("L").save(path.with_suffix(".tif"))
            path.unlink()
        (scene / "rgb").rename(scene / folder)


def _without(*keys: str) -> Callable[[dict[str, Any]], dict[str, Any]]:
    return lambda entry: {k: v for k, v in entry.items() if k not in keys}


_LISTED = "kit/*"
_SCENE = "kit/test/000001/*"
_DATASETS = [
    Variant(
        DATASETS,
        "camera, models and split `test`",
        "all",
        partial(_dataset, lambda r: None),
        _LISTED,
    ),
    Variant(
        DATASETS,
        "`models_cad`; of `models_eval`, `models`, `models_cad` and `models_reconst` the first",
        "T-LESS",
        partial(_dataset, lambda root: _rename(root, models="models_cad")),
        "kit/models*",
    ),
    Variant(
        DATASETS,
        "`models_reconst`",
        "T-LESS",
        partial(_dataset, lambda root: _rename(root, models="models_reconst")),
        "kit/models*",
    ),
    Variant(
        DATASETS,
        "`camera_TYPE.json`",
        "YCB-V, T-LESS, HB",
        partial(_dataset, lambda root: _rename(root, camera="camera_uw.json")),
        "kit/camera*",
    ),
    Variant(
        DATASETS,
        "no camera file: every image has its matrix in `scene_camera.json`",
        "",
        partial(_dataset, lambda root: (root / "camera.json").unlink()),
        _LISTED,
        {"without": "size"},
    ),
    Variant(
        DATASETS,
        "a split with a type",
        "T-LESS, HB",
        partial(_dataset, lambda root: _rename(root, test="test_primesense")),
        "kit/test*",
    ),
    Variant(
        DATASETS,
        "another split, `--split val`, or in the names of results files",
        "HB, ITODD",
        partial(_dataset, lambda root: _rename(root, test="val")),
        "kit/val*",
        {"split": "val"},
    ),
    Variant(
        DATASETS,
        "names that end in the only camera's",
        "BOP-Industrial",
        partial(_dataset, lambda root: name_sensor(root / "test", "cam1")),
        _SCENE,
    ),
    Variant(
        DATASETS,
        "several cameras, of which `--sensor cam1` is one",
        "BOP-Industrial, HOT3D",
        partial(_dataset, _several_cameras),
        _SCENE,
        {"sensor": "cam1"},
    ),
    Variant(
        DATASETS,
        "no `visib_fract`",
        "",
        partial(
            _dataset,
            lambda root: _edit(
                root, "test/*/scene_gt_info.json", _of_each(_without("visib_fract"))
            ),
        ),
        '`{"bbox_obj": [32, 29, 18, 18], …}`',
        {"without": "visibility"},
    ),
    Variant(
        DATASETS,
        "no `scene_gt_info.json`",
        "",
        partial(
            _dataset,
            lambda root: [path.unlink() for path in root.glob("test/*/scene_gt_info.json")],
        ),
        _SCENE,
        {"without": "visibility"},
    ),
]

# --- Images ---------------------------------------------------------------------------------------


def _converted(ending: str, root: Path) -> None:
    for path in list(root.glob("test/*/rgb/*")):
        with Image.open(path) as image:
            image.load()
        path.unlink()
        image.save(path.with_suffix(ending))


def _turned(root: Path) -> None:
    """Store each image turned by 90 degrees, with the EXIF orientation that says so."""
    for path in root.glob("test/*/rgb/*"):
        with Image.open(path) as image:
            exif = Image.Exif()
            exif[0x0112] = 6
            image.transpose(Image.Transpose.ROTATE_90).save(path, exif=exif)


def _twice_as_large(root: Path) -> None:
    for path in root.glob("test/*/rgb/*"):
        with Image.open(path) as image:
            image.resize((2 * SIZE[0], 2 * SIZE[1])).save(path)
    K = [2 * FOCAL, 0, SIZE[0], 0, 2 * FOCAL, SIZE[1], 0, 0, 1]
    _edit(
        root,
        "test/*/scene_camera.json",
        lambda images: {k: {**v, "cam_K": K} for k, v in images.items()},
    )


_SHOWN = "kit/test/000001/*/000003*"
_IMAGES = [
    *(
        Variant(IMAGES, kind, "", partial(_dataset, partial(_converted, ending)), _SHOWN)
        for kind, ending in (("PNG", ".png"), ("TIFF", ".tif"), ("WebP", ".webp"), ("JPEG", ".jpg"))
    ),
    Variant(
        IMAGES,
        "grey, in a folder `gray`; all three channels are the same",
        "ITODD",
        partial(_dataset, _grey),
        _SHOWN,
    ),
    Variant(
        IMAGES,
        "grey, of a named camera",
        "BOP-Industrial",
        partial(_dataset, lambda root: (_grey(root), name_sensor(root / "test", "cam1"))),
        "kit/test/000001/*/*",
    ),
    Variant(
        IMAGES,
        "turned by an EXIF orientation, as OpenCV turns them; a note says so",
        "phones",
        partial(_dataset, _turned),
        "`Orientation: 6`",
    ),
    Variant(
        IMAGES,
        "of another size than `camera.json` says, with their own `cam_K`",
        "",
        partial(_dataset, _twice_as_large),
        f"`{2 * SIZE[0]} x {2 * SIZE[1]}`",
        {"scale": 2},
    ),
]

# --- Models ---------------------------------------------------------------------------------------


def _models(change: Callable[[Path], Any], folder: Path) -> Path:
    """A whole box, 40 x 60 x 100 mm, and its entry of models_info.json, which is changed."""
    import trimesh

    root = write_models(folder / "models")
    box: Any = trimesh.creation.box((40, 60, 100))
    (root / "obj_000001.ply").write_bytes(box.export(file_type="ply", encoding="ascii"))
    change(root)
    return root


def _info(change: Callable[[dict[str, Any]], dict[str, Any]], root: Path) -> None:
    _edit(root, "models_info.json", lambda objects: {k: change(v) for k, v in objects.items()})


def _ply(
    root: Path, vertices: list[str], faces: list[str], extra: str = "", head: str = ""
) -> None:
    (root / "obj_000001.ply").write_text(
        f"ply\nformat ascii 1.0\n{head}element vertex {len(vertices)}\nproperty float x\n"
        f"property float y\nproperty float z\nelement face {len(faces)}\n"
        f"property list uchar int vertex_indices\n{extra}end_header\n"
        + "\n".join([*vertices, *faces])
        + "\n"
    )


_CORNERS = [f"{x} {y} {z}" for x in (-20, 20) for y in (-30, 30) for z in (-50, 50)]
_QUADS = ["4 0 1 3 2", "4 4 6 7 5", "4 0 4 5 1", "4 2 3 7 6", "4 0 2 6 4"]
_TRIANGLES = [
    f"3 {a} {b} {c}"
    for _, a, *rest in (quad.split() for quad in [*_QUADS, "4 1 5 7 3"])
    for b, c in itertools.pairwise(rest)
]
_MIXED = [*_QUADS, "3 1 5 7", "3 1 7 3"]
_COLOURS = "".join(f"property uchar {name}\n" for name in ("red", "green", "blue"))


def mixed_polygons() -> bytes:
    """A binary PLY file with polygons of three and four corners."""
    with tempfile.TemporaryDirectory() as name:
        _ply(Path(name), _CORNERS, _MIXED)
        text = (Path(name) / "obj_000001.ply").read_text()
    head = text.partition("end_header\n")[0].replace("ascii", "binary_little_endian")
    body = np.array([c.split() for c in _CORNERS], dtype="<f4").tobytes()
    for face in _MIXED:
        count, *corners = map(int, face.split())
        body += struct.pack(f"<B{count}i", count, *corners)
    return f"{head}end_header\n".encode() + body


def _binary(root: Path) -> None:
    (root / "obj_000001.ply").write_bytes(mixed_polygons())


_MODELS = [
    Variant(
        MODELS,
        "ASCII or binary PLY in millimetres",
        "all",
        partial(_models, lambda r: None),
        "models/*",
    ),
    Variant(
        MODELS,
        "no `min_*` and `size_*`: those of the mesh",
        "",
        partial(_models, partial(_info, lambda entry: {"diameter": entry["diameter"]})),
        "models/models_info.json",
    ),
    Variant(
        MODELS,
        "a symmetry's axis without `offset`: through the origin",
        "",
        partial(
            _models,
            partial(_info, lambda e: {**e, "symmetries_continuous": [{"axis": [0, 0, 1]}]}),
        ),
        '`{"axis": [0, 0, 1]}`',
        {"symmetric": True},
    ),
    Variant(
        MODELS,
        "polygons of three, four and more corners, in binary too",
        "Blender",
        partial(_models, _binary),
        "`format binary_little_endian 1.0`",
    ),
    Variant(
        MODELS,
        "colours of faces",
        "MeshLab",
        partial(
            _models,
            lambda root: _ply(root, _CORNERS, [f"{f} 200 100 0" for f in _TRIANGLES], _COLOURS),
        ),
        "`3 0 1 3 200 100 0`",
        {"colour": 200},
    ),
    Variant(
        MODELS,
        "a texture that is not there: drawn grey, with a note where colours are wanted",
        "YCB-V, HOPE",
        partial(
            _models, lambda r: _ply(r, _CORNERS, _MIXED, head="comment TextureFile none.png\n")
        ),
        "`comment TextureFile none.png`",
        {"colour": 150},
    ),
    Variant(
        MODELS,
        "vertices of no face, which `models_info.json` does not count: left out, with a note",
        "scans",
        partial(_models, lambda root: _ply(root, [*_CORNERS, "900 0 0"], _MIXED)),
        "`900 0 0`",
    ),
]

VARIANTS = [*_ESTIMATES, *_NAMES, *_DETECTIONS, *_DATASETS, *_IMAGES, *_MODELS]


# --- The tables -----------------------------------------------------------------------------------


def excerpt(variant: Variant) -> str:
    """Return what the table shows of a variant, from the files that it makes."""
    if variant.show.startswith("`"):
        return variant.show
    if variant.kind == NAMES:
        return f"`{variant.show}`"
    with tempfile.TemporaryDirectory() as name:
        path = variant.make(Path(name))
        if variant.show.startswith("line "):
            text = path.read_text().splitlines()[int(variant.show.partition(" ")[2]) - 1]
        else:
            found = sorted(Path(name).glob(variant.show))
            text = ", ".join(f"{p.name}/" if p.is_dir() else p.name for p in found)
    text = text.replace("|", "\\|")
    return f"`{text[:_WIDTH]}{'…' if len(text) > _WIDTH else ''}`"


def tables() -> str:
    """Return the tables of all variants as Markdown."""
    out = []
    for kind, variants in groupby(VARIANTS, key=lambda v: v.kind):
        out.append(f"### {kind}\n\n| variant | as in | example |\n|---|---|---|")
        out += [f"| {v.what} | {v.whose} | {excerpt(v)} |" for v in variants]
        out.append("")
    return "\n".join(out)


def page(text: str) -> str:
    """Return the page with new tables."""
    before, _, rest = text.partition(BEGIN)
    return f"{before}{BEGIN}\n\n{tables()}\n{END}{rest.partition(END)[2]}"


if __name__ == "__main__":
    DOCS.write_text(page(DOCS.read_text(encoding="utf-8")), encoding="utf-8")
    sys.stdout.write(f"{DOCS}: {len(VARIANTS)} variants\n")
