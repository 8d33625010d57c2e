import cv2
import numpy as np
import pytest

from deckline.geometry import Camera
from deckline.recording import RecordingError
from deckline.recording.camera_file import format_camera, read_camera_file

MATRIX = np.array([[438.78, 0.0, 305.59], [0.0, 437.3, 243.74], [0.0, 0.0, 1.0]])
ROS = """image_width: 640
image_height: 480
camera_name: narrow
camera_matrix:
  rows: 3
  cols: 3
  data: [438.78, 0, 305.59, 0, 437.3, 243.74, 0, 0, 1]
distortion_model: {model}
distortion_coefficients:
  rows: 1
  cols: {count}
  data: {data}
"""


def write(tmp_path, text):
    path = tmp_path / "camera.yaml"
    path.write_text(text)
    return path


def ros(model, data):
    return ROS.format(model=model, count=len(data), data=data)


@pytest.mark.parametrize("count", [4, 5, 8, 14])
def test_a_file_that_opencv_writes(tmp_path, count):
    distortion = np.zeros(count)
    distortion[:8] = [-0.36, 0.11, 1e-05, 5e-4, 0.01, 0.02, 0.003, 1e-4][: min(count, 8)]
    storage = cv2.FileStorage(str(tmp_path / "camera.yml"), cv2.FILE_STORAGE_WRITE)
    storage.write("image_width", 640)
    storage.write("image_height", 480)
    storage.write("camera_matrix", MATRIX)
    storage.write("distortion_coefficients", distortion[:, None])
    storage.release()
    camera = read_camera_file(tmp_path / "camera.yml").camera
    np.testing.assert_array_equal(camera.matrix, MATRIX)
    np.testing.assert_array_equal(np.resize([*camera.distortion, 0, 0, 0], 8)[:count], distortion[:8])
    points = np.array([[0.3, -0.2, 1.0], [-0.4, 0.3, 2.0]])
    expected = cv2.projectPoints(points, np.zeros(3), np.zeros(3), MATRIX, distortion)[0][:, 0]
    np.testing.assert_allclose(camera.project(points), expected, atol=1e-9)
    np.testing.assert_allclose(camera.rays(expected), points / points[:, 2:], atol=1e-6)


def test_a_ros_fisheye(tmp_path):
    k = [0.02, -0.01, 0.003, -0.0005]
    camera = read_camera_file(write(tmp_path, ros("equidistant", k))).camera
    angles = np.deg2rad([0.0, 5.0, 30.0, 60.0, 80.0, 88.0])
    points = np.column_stack([np.sin(angles) * 0.6, np.sin(angles) * -0.8, np.cos(angles)]) * 3.0
    expected = cv2.fisheye.projectPoints(points[None], np.zeros(3), np.zeros(3), MATRIX, np.array(k))[0][0]
    np.testing.assert_allclose(camera.project(points), expected, atol=1e-9)
    np.testing.assert_allclose(camera.rays(expected), points / points[:, 2:], rtol=1e-9, atol=1e-12)
    assert np.isnan(camera.rays([[5000.0, 240.0]])[0, 0])


def test_a_fisheye_is_written_and_read_back(tmp_path):
    camera = Camera(640, 480, 200.0, 201.0, 319.5, 239.5, (0.1, 0.2, 0.3, 0.4), fisheye=True)
    mount = read_camera_file(write(tmp_path, ros("plumb_bob", [0.0] * 5))).body_from_camera
    (tmp_path / "camera.toml").write_text(format_camera(camera, mount))
    again = read_camera_file(tmp_path / "camera.toml").camera
    assert again == camera


def test_camera_toml_names_a_calibration_and_adds_the_mount(tmp_path):
    write(tmp_path, ros("rational_polynomial", [0.1] * 8))
    mount = "[body_from_camera]\ntranslation_m = [1.0, 2.0, 3.0]\n"
    (tmp_path / "camera.toml").write_text(f'calibration = "camera.yaml"\ndeck_z_m = -3.0\n{mount}')
    mounted = read_camera_file(tmp_path / "camera.toml")
    assert (mounted.camera.distortion, mounted.deck_z_m) == ((0.1,) * 8, -3.0)
    np.testing.assert_array_equal(mounted.body_from_camera.translation, [1.0, 2.0, 3.0])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "image_width"),
        ("\0\1\2", "not valid YAML"),
        ("[1, 2", "not valid YAML"),
        ("image_width: 640\n", "image_height, camera_matrix missing"),
        (ros("equidistant", [0.0] * 5), "k4 of a fisheye; got 5"),
        (ros("plumb_bob", [0.0] * 3), "got 3"),
        (ros("plumb_bob", [float("nan")] * 5), "nan"),
        (ros("omni", [0.0] * 5), "distortion_model.*'omni'"),
        (ros("plumb_bob", [0.0] * 8 + [0.1] * 6), "beyond k6"),
        (ros("plumb_bob", [0.0] * 5).replace("0, 305", "3, 305"), "camera_matrix"),
        (ros("plumb_bob", [0.0] * 5).replace("640", "wide"), "width.*'wide'"),
    ],
)
def test_files_that_are_no_calibration(tmp_path, text, words):
    with pytest.raises(RecordingError, match=rf"camera\.yaml: .*{words}"):
        read_camera_file(write(tmp_path, text))
