import io
import struct
import zlib

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from PIL import Image
from recording_bytes import PIXELS, pfm, png

from deckline.recording.images import encode_depth, read_image, read_pfm

NOISE = np.random.default_rng(3).integers(0, 256, (24, 32, 3), dtype=np.uint8)


def encode(suffix: str) -> bytes:
    options = [cv2.IMWRITE_WEBP_QUALITY, 101] if suffix == ".webp" else []  # 101: lossless
    return cv2.imencode(suffix, NOISE[:, :, ::-1], options)[1].tobytes()


def read(tmp_path, data):
    path = tmp_path / "image"
    path.write_bytes(data)
    return read_image(path)


RGBA = np.concatenate([PIXELS, np.full((2, 3, 1), 7, np.uint8)], axis=2)
GREY = np.repeat(PIXELS[:, :, 2:], 3, axis=2)


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        (png(PIXELS), PIXELS),
        (png(GREY[:, :, :1], colour_type=0), GREY),
        (png(RGBA, colour_type=6), PIXELS),
        (png(RGBA[:, :, 2:], colour_type=4), GREY),
        (png(PIXELS.astype(np.uint16) * 257, bits=16), PIXELS),
        (png(np.array([[0, 32768, 65535]]), colour_type=0, bits=16), np.array([[[0] * 3, [128] * 3, [255] * 3]])),
        (b"P6 # made by hand\n3 2\n# maximum\n255\n" + PIXELS.tobytes(), PIXELS),
        (b"P6 1 1 4095\n" + bytes([0x0F, 0xFF, 0x08, 0x00, 0, 0]), np.array([[[255, 128, 0]]])),
        (b"P5 2 1 255\n\x07\xff", np.array([[[7] * 3, [255] * 3]])),
        (b"P5 2 1 4095\n\x00\x00\x0f\xff", np.array([[[0] * 3, [255] * 3]])),
    ],
)
def test_every_kind_becomes_red_green_blue_of_8_bits(tmp_path, data, expected):
    image = read(tmp_path, data)
    np.testing.assert_array_equal(image, expected)
    assert image.dtype == np.uint8


@pytest.mark.parametrize("suffix", [".png", ".bmp", ".tif", ".ppm", ".webp"])
def test_lossless_formats_agree_with_opencvs_writer(tmp_path, suffix):
    np.testing.assert_array_equal(read(tmp_path, encode(suffix)), NOISE)


def significant_bits(data: bytes, bits: int) -> bytes:
    """The same 16-bit RGB PNG with an sBIT chunk."""
    body = b"sBIT" + bytes([bits] * 3)
    end = 8 + 25  # of signature and IHDR
    return data[:end] + struct.pack(">I", 3) + body + struct.pack(">I", zlib.crc32(body)) + data[end:]


def test_12_bit_pixels_in_16_bit_png_are_as_bright_as_in_8_bits(tmp_path):
    low = png(PIXELS.astype(np.uint16) * 16 + PIXELS // 16, bits=16)  # 0..4095
    np.testing.assert_array_equal(read(tmp_path, low), PIXELS)
    np.testing.assert_array_equal(read(tmp_path, significant_bits(low, 12)), PIXELS)
    ten_bits = significant_bits(png(PIXELS.astype(np.uint16) * 4 + PIXELS // 64, bits=16), 10)
    np.testing.assert_array_equal(read(tmp_path, ten_bits), PIXELS)
    assert read(tmp_path, significant_bits(low, 16)).max() == 16  # a dark picture that says that all bits count
    scaled = significant_bits(png(PIXELS.astype(np.uint16) * 257, bits=16), 12)  # as the PNG standard wants them
    np.testing.assert_array_equal(read(tmp_path, scaled), PIXELS)


@pytest.mark.parametrize("form", ["JPEG", "PNG", "WEBP"])
def test_exif_orientation_is_applied(tmp_path, form):
    exif = Image.Exif()
    exif[0x0112] = 6  # shown rotated by 90 degrees clockwise
    plain, turned = io.BytesIO(), io.BytesIO()
    Image.fromarray(NOISE).save(plain, form)
    Image.fromarray(NOISE).save(turned, form, exif=exif)
    upright = np.rot90(read(tmp_path, plain.getvalue()), -1)
    np.testing.assert_array_equal(read(tmp_path, turned.getvalue()), upright)


@settings(max_examples=60)
@given(st.sampled_from([".png", ".jpg", ".bmp", ".ppm", ".tif", ".webp"]), st.floats(0.0, 1.0))
def test_no_part_of_a_file_is_used_as_an_image(tmp_path_factory, suffix, part):
    data = encode(suffix)
    path = tmp_path_factory.mktemp("cut") / f"image{suffix}"
    behind_pixels = 5 if suffix == ".png" else 1  # the last checksum of a PNG is that of an empty chunk
    path.write_bytes(data[: min(int(part * len(data)), len(data) - behind_pixels)])
    with pytest.raises(ValueError):
        read_image(path)


@settings(max_examples=60)
@given(st.sampled_from([".png", ".jpg", ".bmp", ".ppm", ".tif", ".webp"]), st.data())
def test_damaged_bytes_are_an_image_or_a_value_error(tmp_path_factory, suffix, data):
    whole = bytearray(encode(suffix))
    for place in data.draw(st.lists(st.integers(0, min(len(whole) - 1, 400)), min_size=1, max_size=5)):
        whole[place] ^= data.draw(st.integers(1, 255))
    path = tmp_path_factory.mktemp("damaged") / "image"
    path.write_bytes(bytes(whole))
    try:
        image = read_image(path)
    except ValueError as error:
        assert "\n" not in str(error)
    else:
        assert image.dtype == np.uint8 and image.shape[2] == 3


def test_cut_jpeg_is_found_though_its_thumbnail_is_whole(tmp_path):
    whole, thumbnail = encode(".jpg"), cv2.imencode(".jpg", NOISE[:8, :8])[1].tobytes()
    exif = b"Exif\0\0" + thumbnail
    data = whole[:2] + b"\xff\xe1" + struct.pack(">H", len(exif) + 2) + exif + whole[2:]
    assert read(tmp_path, data).shape == NOISE.shape
    with pytest.raises(ValueError, match="cut short"):
        read(tmp_path, data[: len(data) // 2 + len(exif) // 2])


@pytest.mark.parametrize("options", [[], [cv2.IMWRITE_JPEG_PROGRESSIVE, 1, cv2.IMWRITE_JPEG_RST_INTERVAL, 1]])
def test_jpeg_with_bytes_behind_its_end_agrees_with_opencvs_reader(tmp_path, options):
    data = cv2.imencode(".jpg", NOISE, options)[1].tobytes()
    opencv = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)[:, :, ::-1]
    np.testing.assert_array_equal(read(tmp_path, data + b"maker's notes"), opencv)


def test_damaged_png_is_refused(tmp_path):
    data = bytearray(encode(".png"))
    data[len(data) // 2] ^= 1
    with pytest.raises(ValueError, match=r"PNG.*IDAT"):
        read(tmp_path, bytes(data))


@pytest.mark.parametrize(
    ("data", "text"),
    [
        (b"", "empty"),
        (b"GIF89a", "PNG, JPEG"),
        (b"P6 1 1 0\nabc", "damaged"),
        (cv2.imencode(".tif", NOISE.astype(np.float32))[1].tobytes(), "PNG, JPEG|bits"),
    ],
)
def test_what_is_no_image_says_so(tmp_path, data, text):
    with pytest.raises(ValueError, match=text):
        read(tmp_path, data)


@pytest.mark.parametrize("name", ["nothing.png", ""])
def test_missing_file_and_folder_are_named(tmp_path, name):
    with pytest.raises(ValueError, match=str(tmp_path / name)):
        read_image(tmp_path / name)


@pytest.mark.parametrize("order", ["<", ">"])
def test_first_row_of_a_pfm_is_the_top_one_as_airsim_writes_it(order):
    depth = read_pfm(pfm([[1.0, 2.0], [3.0, 4.0], [5.0, 6.5]], order))
    assert depth.tolist() == [[1.0, 2.0], [3.0, 4.0], [5.0, 6.5]]
    assert depth.dtype == np.float32
    assert encode_depth(depth) == pfm([[1.0, 2.0], [3.0, 4.0], [5.0, 6.5]])


def test_pfm_from_bottom_to_top_agrees_with_opencv():
    data = pfm([[1.5, 2.0], [3.0, 4.25], [-5.0, 6.0]])
    opencv = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(read_pfm(data, "bottom-to-top"), opencv)


@given(arrays(np.float32, array_shapes(min_dims=2, max_dims=2, max_side=6), elements=st.floats(0, 1e6, width=32)))
def test_depth_round_trip(depth_m):
    np.testing.assert_array_equal(read_pfm(encode_depth(depth_m)), depth_m)


def test_depth_of_nothing_is_airsims_largest_number():
    assert encode_depth(np.float32([[np.nan, np.inf]])) == pfm([[65504.0, 65504.0]])


@pytest.mark.parametrize(
    ("data", "text"),
    [
        (b"PF\n1 1\n-1\n" + bytes(12), "PF"),
        (b"P6\n1 1\n255\nabc", "PFM"),
        (b"Pf\n1 1\n-2\n" + bytes(4), "scale.*-2"),
        (b"Pf\n1 1\n--\n" + bytes(4), "scale.*'--'"),
        (b"Pf\n2 2\n-1\n" + bytes(15), "2x2.* 15 of 16"),
        (b"Pf\n999999999 999999999\n-1\n" + bytes(15), "15 of 39999"),
        (b"Pf\n0 2\n-1\n", "0x2"),
    ],
)
def test_bad_pfm_says_what_is_wrong(data, text):
    with pytest.raises(ValueError, match=text):
        read_pfm(data)
