"""RGB images of a BOP dataset: found, read, and refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from bop_images import IMAGES, SIZE, write_dataset, write_image
from graspcast.bop.dataset import BopDataset
from graspcast.bop.images import read_image, read_image_size
from graspcast.errors import FormatError, InputError


@pytest.mark.parametrize("ending", [".png", ".jpg", ".webp"])
def test_images_are_found_and_read(tmp_path: Path, ending: str) -> None:
    dataset = write_dataset(tmp_path / "made", ending)
    assert tuple(sorted(dataset.images)) == IMAGES
    assert dataset.image_size == SIZE
    image = dataset.image(1, 8)
    assert image.shape == (SIZE[1], SIZE[0], 3)
    assert image.dtype == np.uint8
    with Image.open(dataset.images[1, 8]) as given:
        assert np.array_equal(image, np.asarray(given.convert("RGB")))
    assert not np.array_equal(image, dataset.image(1, 3))


def test_red_is_the_first_channel(tmp_path: Path) -> None:
    Image.new("RGB", (4, 2), (250, 3, 1)).save(tmp_path / "red.png")
    assert read_image(tmp_path / "red.png")[0, 0].tolist() == [250, 3, 1]


@pytest.mark.parametrize(
    ("mode", "says"),
    [
        ("RGBA", "has an alpha channel"),
        ("LA", "has an alpha channel"),
        ("L", "is grayscale"),
        ("1", "is black and white"),
        ("P", "has a palette"),
        ("CMYK", "is of mode CMYK"),
    ],
)
def test_images_that_are_not_rgb_are_refused(tmp_path: Path, mode: str, says: str) -> None:
    path = write_image(tmp_path / ("a.jpg" if mode == "CMYK" else "a.png"), mode=mode)
    with pytest.raises(FormatError, match=f"{says}.*needs three channels"):
        read_image(path)


def test_an_image_beyond_all_measure_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_image(tmp_path / "a.png")
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 100)
    with pytest.raises(FormatError, match="is too large an image"):
        read_image(path)


def test_another_size_is_refused(tmp_path: Path) -> None:
    dataset = write_dataset(tmp_path)
    write_image(dataset.images[2, 3], size=(64, 96))
    with pytest.raises(FormatError, match=r"000003.png: has 64 x 96 pixels, but .* says 96 x 64"):
        dataset.image(2, 3)


def test_sizes_are_not_compared_where_none_is_stated(tmp_path: Path) -> None:
    write_image(tmp_path / "test" / "000001" / "rgb" / "000000.png", size=(30, 20))
    dataset = BopDataset(tmp_path)
    assert dataset.image_size is None
    assert dataset.image(1, 0).shape == (20, 30, 3)


@pytest.mark.parametrize("share", [0.0, 0.5])
@pytest.mark.parametrize("ending", [".png", ".jpg", ".webp"])
def test_broken_images_are_named(tmp_path: Path, ending: str, share: float) -> None:
    path = write_image(tmp_path / f"cut{ending}")
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(FormatError, match=f"cut{ending}: (cannot be read|is not a PNG)"):
        read_image(path)


def test_an_image_that_is_not_there(tmp_path: Path) -> None:
    dataset = write_dataset(tmp_path)
    with pytest.raises(InputError, match="no image 1/4 in"):
        dataset.image(1, 4)
    with pytest.raises(FormatError, match="cannot be read"):
        read_image(tmp_path / "nowhere.png")
    with pytest.raises(InputError, match="no RGB images here; they should be SCENE/rgb/IMAGE"):
        BopDataset(tmp_path, split="train").images  # noqa: B018


def test_the_same_image_twice_is_refused(tmp_path: Path) -> None:
    dataset = write_dataset(tmp_path)
    write_image(tmp_path / "test" / "000001" / "rgb" / "3.jpg")
    with pytest.raises(InputError, match="the same scene and image as"):
        dataset.images  # noqa: B018


def test_real_images(data_dir: Path) -> None:
    dataset = BopDataset(data_dir / "bop" / "lmo")
    assert len(dataset.images) == 200
    assert dataset.image(2, 3).shape == (480, 640, 3)


@pytest.mark.filterwarnings("error")
def test_a_large_image_is_no_warning(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 100)
    for side in (12, 20):
        Image.new("RGB", (side, side)).save(tmp_path / f"{side}.png")
    assert read_image(tmp_path / "12.png").shape == (12, 12, 3)
    with pytest.raises(FormatError, match="is too large an image"):
        read_image(tmp_path / "20.png")


def test_what_is_no_scene_and_no_image_is_left_out(tmp_path: Path) -> None:
    write_dataset(tmp_path)
    write_image(tmp_path / "test" / "notes" / "rgb" / "3.png")
    (tmp_path / "test" / "000001" / "rgb" / "thumbs.db").write_text("")
    (tmp_path / "test" / "000001" / "rgb" / "4.txt").write_text("")
    assert tuple(sorted(BopDataset(tmp_path).images)) == IMAGES


def test_images_are_turned_as_their_exif_says(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = write_image(tmp_path / "a.png")
    upright = read_image(path)
    with Image.open(path) as image:
        exif = image.getexif()
        exif[0x0112] = 6  # to be turned by a quarter, clockwise
        image.save(tmp_path / "turned.png", exif=exif)
    turned = read_image(tmp_path / "turned.png")
    np.testing.assert_array_equal(turned, np.rot90(upright, -1))
    assert read_image_size(tmp_path / "turned.png") == (SIZE[1], SIZE[0])
    assert "images are turned as their EXIF says" in caplog.text
    with pytest.raises(FormatError, match="64 x 96 pixels, turned as its EXIF orientation 6 says"):
        read_image(tmp_path / "turned.png", size=SIZE)
