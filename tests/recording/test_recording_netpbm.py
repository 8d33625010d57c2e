import subprocess
import sys

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from recording_bytes import PIXELS, pfm

from deckline.recording.netpbm import read_pfm, read_ppm, write_pfm, write_ppm


def test_pfm_of_airsim_has_its_first_row_on_top():
    depth = read_pfm(pfm([[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]]))
    assert depth.tolist() == [[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]]
    assert depth.dtype == np.float32


def test_pfm_by_the_definition_has_its_first_row_below():
    assert read_pfm(pfm([[1.0, 2.0], [3.0, 4.0]]), "bottom-to-top").tolist() == [[3.0, 4.0], [1.0, 2.0]]


def test_pfm_bottom_to_top_agrees_with_opencv():
    data = pfm([[1.5, 2.0], [3.0, 4.25], [-5.0, 6.0]])
    opencv = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(read_pfm(data, "bottom-to-top"), opencv)


def test_pfm_big_endian_has_a_positive_scale():
    assert read_pfm(pfm([[1.0, 2.5]], order=">")).tolist() == [[1.0, 2.5]]


def test_pfm_written_is_airsims_bytes():
    assert write_pfm(np.array([[1.0, 2.0], [3.0, 4.0]], np.float32)) == pfm([[1.0, 2.0], [3.0, 4.0]])


@given(
    arrays(np.float32, array_shapes(min_dims=2, max_dims=2, max_side=6)),
    st.sampled_from(["top-to-bottom", "bottom-to-top"]),
)
def test_pfm_round_trip(values, rows):
    np.testing.assert_array_equal(read_pfm(write_pfm(values, rows), rows), values)


@pytest.mark.parametrize(
    ("data", "text"),
    [
        (b"PF\n1 1\n-1\n" + bytes(12), r"colour PFM \(PF\), expected one channel"),
        (b"P6\n1 1\n255\nabc", "not a PFM file"),
        (b"Pf\n1 1\n-2\n" + bytes(4), "scale must be -1 .* or 1 .*, got -2"),
        (b"Pf\n1 1\n--\n" + bytes(4), "scale is no number: '--'"),
        (b"Pf\n2 2\n-1\n" + bytes(15), "cut short: 15 of 16 bytes"),
        (b"Pf\n999999999 999999999\n-1\n" + bytes(15), "cut short: 15 of 39999"),
        (b"Pf\n0 2\n-1\n", "0x2 px has no pixels"),
    ],
)
def test_bad_pfm_says_what_is_wrong(data, text):
    with pytest.raises(ValueError, match=text):
        read_pfm(data)


def test_ppm_is_red_green_blue_with_comments_allowed():
    data = b"P6 # made by hand\n3 2\n# maximum\n255\n" + PIXELS.tobytes()
    np.testing.assert_array_equal(read_ppm(data), PIXELS)


def test_ppm_with_16_bits_is_scaled_from_its_maximum():
    assert read_ppm(b"P6 1 1 4095\n" + bytes([0x0F, 0xFF, 0x08, 0x00, 0, 0])).tolist() == [[[255, 128, 0]]]


def test_pgm_is_repeated_over_the_channels():
    assert read_ppm(b"P5 2 1 255\n\x07\xff").tolist() == [[[7, 7, 7], [255, 255, 255]]]


@given(arrays(np.uint8, st.tuples(st.integers(1, 5), st.integers(1, 5), st.just(3))))
def test_ppm_round_trip(image):
    np.testing.assert_array_equal(read_ppm(write_ppm(image)), image)


@pytest.mark.parametrize(
    ("data", "text"),
    [
        (b"P3 1 1 255\n1 2 3\n", "not a binary PPM or PGM"),
        (b"P6 2 1 255\nabcde", "cut short: 5 of 6 bytes"),
        (b"P6 1 1 0\nabc", "maximum must be 1 to 65535, got 0"),
    ],
)
def test_bad_ppm_says_what_is_wrong(data, text):
    with pytest.raises(ValueError, match=text):
        read_ppm(data)


def test_ppm_recording_needs_no_opencv_and_no_pyav(tmp_path):
    code = f"""
import sys
sys.modules.update(cv2=None, av=None, onnxruntime=None)
import numpy as np
from pathlib import Path
from deckline.geometry import Camera, pose
from deckline.recording import RecordingWriter, open_recording
from deckline.types import Frame
with RecordingWriter(Path({str(tmp_path / "r")!r}), image_format="ppm") as writer:
    image = np.full((2, 3, 3), 9, np.uint8)
    writer.add(Frame("a", 0.0, image, Camera.from_fov(3, 2, 1.0), world_from_body=pose([0, 0, 0], [1, 0, 0, 0])))
print(open_recording({str(tmp_path / "r")!r}).load(0).image_rgb.sum())
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == str(9 * 18)
