import struct

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from recording_bytes import PIXELS, png

from deckline.recording.images import encode_image, read_image

NOISE = np.random.default_rng(3).integers(0, 256, (24, 32, 3), dtype=np.uint8)


def encoded(suffix: str) -> bytes:
    return cv2.imencode(suffix, NOISE[:, :, ::-1])[1].tobytes()


def read(tmp_path, data):
    path = tmp_path / "image"
    path.write_bytes(data)
    return read_image(path)


def test_png_is_red_green_blue(tmp_path):
    np.testing.assert_array_equal(read(tmp_path, png(PIXELS)), PIXELS)


def test_grey_png_is_repeated_over_the_channels(tmp_path):
    image = read(tmp_path, png(PIXELS[:, :, :1], colour_type=0))
    np.testing.assert_array_equal(image, np.repeat(PIXELS[:, :, :1], 3, axis=2))


def test_16_bit_png_is_scaled_to_8(tmp_path):
    image = read(tmp_path, png(PIXELS.astype(np.uint16) * 257, bits=16))
    np.testing.assert_array_equal(image, PIXELS)


def test_16_bit_grey_png(tmp_path):
    assert read(tmp_path, png(np.array([[0, 32768, 65535]]), colour_type=0, bits=16))[0, :, 1].tolist() == [0, 128, 255]


def test_transparency_is_dropped(tmp_path):
    rgba = np.concatenate([PIXELS, np.full((2, 3, 1), 7, np.uint8)], axis=2)
    np.testing.assert_array_equal(read(tmp_path, png(rgba, colour_type=6)), PIXELS)
    np.testing.assert_array_equal(read(tmp_path, png(rgba[:, :, 2:], colour_type=4))[:, :, 0], PIXELS[:, :, 2])


@pytest.mark.parametrize("suffix", [".png", ".bmp", ".tif", ".ppm"])
def test_lossless_formats_agree_with_opencvs_writer(tmp_path, suffix):
    np.testing.assert_array_equal(read(tmp_path, encoded(suffix)), NOISE)


def test_jpeg_is_near_and_in_the_right_order(tmp_path):
    red = np.zeros((16, 16, 3), np.uint8)
    red[:, :, 0] = 200
    data = cv2.imencode(".jpg", red[:, :, ::-1])[1].tobytes()
    np.testing.assert_allclose(read(tmp_path, data)[8, 8], [200, 0, 0], atol=3)


def test_orientation_tag_is_ignored(tmp_path):
    data = cv2.imencode(".jpg", NOISE)[1].tobytes()
    tag = struct.pack("<HHIHH", 0x0112, 3, 1, 6, 0)  # rotate by 90 degrees
    exif = b"Exif\0\0II*\0" + struct.pack("<IH", 8, 1) + tag + bytes(4)
    turned = data[:2] + b"\xff\xe1" + struct.pack(">H", len(exif) + 2) + exif + data[2:]
    np.testing.assert_array_equal(read(tmp_path, turned), read(tmp_path, data))


@settings(max_examples=60, deadline=None)
@given(st.sampled_from([".png", ".jpg", ".bmp", ".ppm", ".tif"]), st.floats(0.0, 1.0))
def test_no_part_of_a_file_is_used_as_an_image(tmp_path_factory, suffix, part):
    data = encoded(suffix)
    path = tmp_path_factory.mktemp("cut") / f"image{suffix}"
    path.write_bytes(data[: min(int(part * len(data)), len(data) - 1)])
    with pytest.raises(ValueError):
        read_image(path)


def test_cut_png_and_jpeg_say_so(tmp_path):
    with pytest.raises(ValueError, match=r"PNG cut short: it ends after .* without its closing IEND"):
        read(tmp_path, encoded(".png")[:-12])
    with pytest.raises(ValueError, match="JPEG cut short"):
        read(tmp_path, encoded(".jpg")[:-2])


def test_cut_jpeg_is_found_though_its_thumbnail_is_whole(tmp_path):
    whole, thumbnail = encoded(".jpg"), cv2.imencode(".jpg", NOISE[:8, :8])[1].tobytes()
    exif = b"Exif\0\0" + thumbnail
    data = whole[:2] + b"\xff\xe1" + struct.pack(">H", len(exif) + 2) + exif + whole[2:]
    assert read(tmp_path, data).shape == NOISE.shape
    with pytest.raises(ValueError, match="JPEG cut short"):
        read(tmp_path, data[: len(data) // 2 + len(exif) // 2])


def test_progressive_jpeg_with_bytes_behind_its_end_is_whole(tmp_path):
    options = [cv2.IMWRITE_JPEG_PROGRESSIVE, 1, cv2.IMWRITE_JPEG_RST_INTERVAL, 1]
    data = cv2.imencode(".jpg", NOISE, options)[1].tobytes()
    assert read(tmp_path, data + b"maker's notes").shape == NOISE.shape


def test_damaged_png_is_refused(tmp_path):
    data = bytearray(encoded(".png"))
    data[len(data) // 2] ^= 1
    with pytest.raises(ValueError, match="damaged PNG: wrong checksum in its 'IDAT' chunk"):
        read(tmp_path, bytes(data))


@pytest.mark.parametrize(
    ("data", "text"), [(b"", "empty file"), (b"GIF89a", "not an image of a known format"), (b"hello", "not an image")]
)
def test_what_is_no_image_says_so(tmp_path, data, text):
    with pytest.raises(ValueError, match=text):
        read(tmp_path, data)


def test_missing_file_and_folder_say_so(tmp_path):
    with pytest.raises(ValueError, match=r"image is missing: .*nothing\.png"):
        read_image(tmp_path / "nothing.png")
    with pytest.raises(ValueError, match="image cannot be read"):
        read_image(tmp_path)


@pytest.mark.parametrize("image_format", ["png", "ppm"])
def test_encoded_images_read_back(tmp_path, image_format):
    np.testing.assert_array_equal(read(tmp_path, encode_image(NOISE, image_format)), NOISE)
