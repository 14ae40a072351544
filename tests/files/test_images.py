"""Pictures in: every format, depth and colour; everything else is refused in one line."""

from __future__ import annotations

import struct
import zlib
from itertools import product

import cv2
import numpy as np
import PIL.Image
import pytest

from retrue.errors import CaptureError, FileError, InputError
from retrue.files.images import read_folder, read_image, write_png
from retrue.files.jpeg import whole_scans

RAMP = np.add.outer(np.arange(20), 3 * np.arange(30)).astype(np.uint8)
COLOR = np.stack([RAMP, RAMP // 2, 255 - RAMP], axis=-1)


@pytest.mark.parametrize("suffix", ["png", "bmp", "tif"])
def test_eight_bit_pictures_come_back_as_they_were(tmp_path, suffix):
    cv2.imwrite(str(tmp_path / f"grey.{suffix}"), RAMP)
    cv2.imwrite(str(tmp_path / f"color.{suffix}"), COLOR[..., ::-1])
    assert np.array_equal(read_image(tmp_path / f"color.{suffix}"), COLOR)
    grey = read_image(tmp_path / f"grey.{suffix}", grey=True)
    assert np.array_equal(grey, RAMP)


@pytest.mark.parametrize("suffix", ["png", "tif"])
def test_sixteen_bit_pictures_keep_their_depth(tmp_path, suffix):
    deep = RAMP.astype(np.uint16) * 257
    cv2.imwrite(str(tmp_path / f"deep.{suffix}"), deep)
    read = read_image(tmp_path / f"deep.{suffix}")
    assert read.dtype == np.uint16
    assert np.array_equal(read, deep)


@pytest.mark.parametrize("depth", [np.uint8, np.uint16])
@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("channels", [3, 4])
def test_what_a_tiff_says_beside_its_pixels_is_passed_over_in_silence(tmp_path, capfd, depth, order, channels):
    picture = np.random.default_rng(5).integers(0, 256, (21, 30, channels)).astype(depth)
    pixels = picture.astype(np.dtype(depth).newbyteorder(order)).tobytes()
    bits, values = (
        np.dtype(depth).itemsize * 8,
        {256: 30, 257: 21, 259: 1, 262: 2, 273: 8, 277: channels, 279: len(pixels)},
    )
    entries = [(tag, 4, 1, struct.pack(order + "I", value)) for tag, value in values.items() if tag in (273, 279)]
    entries += [
        (tag, 3, 1, struct.pack(order + "HH", value, 0)) for tag, value in values.items() if tag not in (273, 279)
    ]
    place = 8 + len(pixels)
    entries += [
        (258, 3, channels, struct.pack(order + "I", place)),
        (40000, 3, 1, bytes(4)),
    ]  # no tag that libtiff knows
    directory = b"".join(struct.pack(order + "HHI4s", *entry) for entry in sorted(entries))
    start = (b"II*\0" if order == "<" else b"MM\0*") + struct.pack(order + "I", place + 2 * channels)
    depths = struct.pack(order + "H", bits) * channels
    count = struct.pack(order + "H", len(entries))
    (tmp_path / "a.tif").write_bytes(start + pixels + depths + count + directory + bytes(4))
    assert np.array_equal(read_image(tmp_path / "a.tif"), picture[..., :3])
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize(
    ("mode", "compression"),
    [
        *product(["RGB", "L", "P", "YCbCr", "CMYK", "1"], ["raw", "tiff_lzw", "packbits"]),
        ("1", "group3"),
        ("1", "group4"),
    ],
)
def test_a_tiff_of_any_packing_has_the_pixels_that_opencv_reads_of_the_whole(tmp_path, mode, compression):
    smooth = cv2.GaussianBlur(np.random.default_rng(6).integers(0, 256, (48, 64, 3)).astype(np.float32), (0, 0), 3)
    picture = cv2.normalize(smooth, None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)
    PIL.Image.fromarray(picture).convert(mode).save(tmp_path / "a.tif", compression=compression)
    grey = mode in ("L", "1")
    whole = cv2.imread(str(tmp_path / "a.tif"), cv2.IMREAD_GRAYSCALE if grey else cv2.IMREAD_COLOR_RGB)
    assert whole is not None
    assert np.ptp(whole) > 100
    assert np.array_equal(read_image(tmp_path / "a.tif"), whole)


def test_jpeg_in_colour_is_red_green_blue(tmp_path):
    cv2.imwrite(str(tmp_path / "a.jpg"), np.full((32, 32, 3), (20, 40, 200), np.uint8))
    assert np.abs(read_image(tmp_path / "a.jpg").astype(int) - (200, 40, 20)).max() < 6


@pytest.mark.parametrize(
    "content",
    [b"", b"hello", b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff\xe0\x00", b"BM", b"II*\0\xff\xff\xff\x7f", b"\xff\xd8" * 40],
)
def test_what_is_no_picture_is_refused(tmp_path, content):
    (tmp_path / "a.png").write_bytes(content)
    with pytest.raises(FileError, match=r"a\.png: not a picture"):
        read_image(tmp_path / "a.png")


def test_a_damaged_png_is_told_by_us_alone(tmp_path, capfd):
    noise = np.random.default_rng(0).integers(0, 256, (300, 400), dtype=np.uint8)
    content = bytearray(cv2.imencode(".png", noise)[1].tobytes())
    for place in range(2000, len(content) - 2000, 5000):
        content[place] ^= 255
    (tmp_path / "a.png").write_bytes(bytes(content))
    with pytest.raises(FileError, match=r"a\.png: not a picture that can be read: damaged"):
        read_image(tmp_path / "a.png")
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("flags", [[], [cv2.IMWRITE_JPEG_PROGRESSIVE, 1], [cv2.IMWRITE_JPEG_RST_INTERVAL, 5]])
def test_a_jpeg_that_was_written_over_is_told_by_us_alone(tmp_path, capfd, flags):
    rng = np.random.default_rng(0)
    content = cv2.imencode(".jpg", rng.integers(0, 256, (300, 400), dtype=np.uint8), flags)[1].tobytes()
    (tmp_path / "whole.jpg").write_bytes(content + rng.bytes(5000))  # cameras keep a second picture behind the first
    assert read_image(tmp_path / "whole.jpg").shape == (300, 400)
    middle = len(content) // 2
    (tmp_path / "a.jpg").write_bytes(content[:middle] + rng.bytes(4096) + content[middle + 4096 :])
    with pytest.raises(FileError, match=r"a\.jpg: not a picture that can be read: damaged"):
        read_image(tmp_path / "a.jpg")
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("flags", [[], [cv2.IMWRITE_JPEG_PROGRESSIVE, 1], [cv2.IMWRITE_JPEG_RST_INTERVAL, 5]])
def test_what_is_written_over_a_jpeg_may_look_like_one_of_its_parts(flags):
    rng = np.random.default_rng(1)
    content = cv2.imencode(".jpg", rng.integers(0, 256, (300, 400), dtype=np.uint8), flags)[1].tobytes()
    places = rng.integers(len(content) // 4, len(content) - 5000, 40).tolist()
    damaged = [content[:place] + rng.bytes(4096) + content[place + 4096 :] for place in places]
    assert whole_scans(content, 500) > 0
    assert sum(whole_scans(one, 500) == 0 for one in damaged) >= 39  # one in some 250 has an end of its own


@pytest.mark.parametrize("flags", [[], [cv2.IMWRITE_JPEG_OPTIMIZE, 1], [cv2.IMWRITE_JPEG_RST_INTERVAL, 5]])
@pytest.mark.parametrize("channels", [(), (3,)])
def test_bytes_that_a_jpeg_lost_or_that_were_emptied_are_missed(tmp_path, capfd, flags, channels):
    rng = np.random.default_rng(2)
    content = cv2.imencode(".jpg", rng.integers(0, 256, (301, 407, *channels), dtype=np.uint8), flags)[1].tobytes()
    (tmp_path / "whole.jpg").write_bytes(content)
    assert read_image(tmp_path / "whole.jpg").shape == (301, 407, *channels)
    for place in rng.integers(len(content) // 4, len(content) - 5000, 10).tolist():
        for damaged in (
            content[:place] + bytes(4096) + content[place + 4096 :],
            content[:place] + content[place + 512 :],
        ):
            (tmp_path / "a.jpg").write_bytes(damaged)
            with pytest.raises(FileError, match=r"a\.jpg: not a picture that can be read: damaged"):
                read_image(tmp_path / "a.jpg")
    assert capfd.readouterr().err == ""


def test_a_few_bytes_behind_a_jpegs_pixels_are_no_damage():
    content = cv2.imencode(".jpg", RAMP)[1].tobytes()
    assert whole_scans(content, 500) == 1
    assert whole_scans(content[:-2] + bytes(8) + content[-2:], 500) == 1
    assert whole_scans(content[:-2] + bytes(100) + content[-2:], 500) == 0


def test_any_size_any_sampling_any_quality_of_a_jpeg_is_whole():
    rng = np.random.default_rng(4)
    samplings = [0x411111, 0x221111, 0x211111, 0x121111, 0x111111]
    for _ in range(60):
        height, width = rng.integers(1, 70, 2).tolist()
        picture = rng.integers(0, 256, (height, width, 3), dtype=np.uint8)
        picture = cv2.GaussianBlur(picture, (0, 0), rng.uniform(0.3, 4))
        sampling = [cv2.IMWRITE_JPEG_SAMPLING_FACTOR, samplings[rng.integers(5)]]
        quality = [cv2.IMWRITE_JPEG_QUALITY, int(rng.integers(1, 101))]
        for shown in (picture, picture[..., 0]):
            assert whole_scans(cv2.imencode(".jpg", shown, [*sampling, *quality])[1].tobytes(), 500) == 1


def test_a_jpeg_of_too_many_scans_is_refused(tmp_path):
    content = cv2.imencode(".jpg", RAMP)[1].tobytes()
    start = content.index(b"\xff\xda")
    (tmp_path / "a.jpg").write_bytes(content[:start] + 600 * content[start:-2] + content[-2:])
    with pytest.raises(FileError, match="at most 500 scans"):
        read_image(tmp_path / "a.jpg")


def test_cut_short_is_refused(tmp_path):
    noise = np.random.default_rng(0).integers(0, 256, (64, 64), dtype=np.uint8)
    whole = cv2.imencode(".png", noise)[1].tobytes()
    (tmp_path / "a.png").write_bytes(whole[: len(whole) // 20])
    with pytest.raises(FileError, match="damaged or cut short"):
        read_image(tmp_path / "a.png")


def test_a_bomb_is_refused_by_its_header(tmp_path):
    def chunk(name, data):
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))

    header = chunk(b"IHDR", struct.pack(">IIBBBBB", 100_000, 100_000, 8, 0, 0, 0, 0))
    (tmp_path / "bomb.png").write_bytes(b"\x89PNG\r\n\x1a\n" + header)
    with pytest.raises(FileError, match="found 100000 x 100000"):
        read_image(tmp_path / "bomb.png")


def test_missing_file(tmp_path):
    with pytest.raises(FileError, match="No such file"):
        read_image(tmp_path / "none.png")


@pytest.mark.parametrize(
    "names",
    [
        ["0.png", "1.png", "2.png", "10.png", "11.png"],
        ["img1.png", "img2.png", "img9.png", "img10.png", "img100.png"],
        ["graycode_00.png", "graycode_01.PNG", "graycode_02.png", "graycode_10.png", "graycode_11.png"],
    ],
)
def test_folder_is_sorted_by_number_and_strays_are_ignored(tmp_path, names):
    for value, name in enumerate(names):
        (tmp_path / name).write_bytes(cv2.imencode(".png", np.full((8, 9), value, np.uint8))[1].tobytes())
    for stray in ("Thumbs.db", "pattern.json", "notes.txt", "._0.png", ".DS_Store"):
        (tmp_path / stray).write_bytes(b"stray")
    images, paths = read_folder(tmp_path)
    assert [path.name for path in paths] == names
    assert [int(image[0, 0]) for image in images] == [0, 1, 2, 3, 4]


def test_folder_is_grey_but_for_what_is_asked_in_colour(tmp_path):
    for index in range(3):
        cv2.imwrite(str(tmp_path / f"{index}.png"), COLOR)
    images, _ = read_folder(tmp_path, color=(-1,))
    assert [image.ndim for image in images] == [2, 2, 3]


def test_mixed_sizes_are_named(tmp_path):
    for index in range(4):
        cv2.imwrite(str(tmp_path / f"{index}.png"), RAMP[: 20 - (index == 2)])
    with pytest.raises(CaptureError, match=r"2\.png is 30 x 19 pixels, the others 30 x 20: .* out of the folder"):
        read_folder(tmp_path)


def test_no_folder_and_empty_folder(tmp_path):
    with pytest.raises(CaptureError, match="no such folder"):
        read_folder(tmp_path / "none")
    with pytest.raises(CaptureError, match=r"no pictures in it: .* TIFF files$"):
        read_folder(tmp_path)
    for name in ("pose2", "pose1"):
        (tmp_path / name).mkdir()
    with pytest.raises(CaptureError, match=r"found 2 folders: hand those in, as .*pose1$"):
        read_folder(tmp_path)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("shape", [(5, 7), (5, 7, 3)])
def test_every_pixel_comes_back(tmp_path, shape, dtype):
    image = np.random.default_rng(0).integers(0, np.iinfo(dtype).max, shape, dtype=dtype, endpoint=True)
    write_png(tmp_path / "picture.png", image)
    again = read_image(tmp_path / "picture.png")
    assert again.dtype == dtype
    assert np.array_equal(again, image)


@pytest.mark.parametrize(
    "image", [np.zeros((4, 4)), np.zeros((4, 4, 2), np.uint8), np.zeros((0, 4), np.uint8), np.zeros(4, np.uint8)]
)
def test_what_is_no_picture(tmp_path, image):
    with pytest.raises(InputError, match="picture: expected grey or RGB"):
        write_png(tmp_path / "picture.png", image)
    assert not list(tmp_path.iterdir())


def test_no_such_folder(tmp_path):
    with pytest.raises(FileError, match="cannot be written"):
        write_png(tmp_path / "no" / "picture.png", np.zeros((4, 4), np.uint8))
