import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from recording_bytes import CAMERA
from scipy.spatial.transform import RigidTransform, Rotation

from deckline.geometry import Camera
from deckline.recording import RecordingError
from deckline.recording.camera_file import camera_from_mapping, camera_to_mapping, read_camera_file


def write(tmp_path, text):
    path = tmp_path / "camera.toml"
    path.write_text(text)
    return path


def test_values_and_defaults(tmp_path):
    mounted = read_camera_file(write(tmp_path, CAMERA))
    camera = mounted.camera
    assert (camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy) == (3, 2, 4.0, 5.0, 1.0, 0.5)
    assert camera.distortion == (0.0,) * 5
    assert mounted.deck_z_m is None
    forward = mounted.body_from_camera.apply([0.0, 0.0, 1.0])  # the optical axis is the body's forward axis
    np.testing.assert_allclose(forward, [1.0, 0.0, 0.0], atol=1e-12)
    moved = read_camera_file(write(tmp_path, CAMERA + "[body_from_camera]\ntranslation_m = [1, 2, 3]\n"))
    np.testing.assert_allclose(moved.body_from_camera.apply([0.0, 0.0, 1.0]), [2.0, 2.0, 3.0], atol=1e-12)


def test_mount_distortion_and_deck(tmp_path):
    text = CAMERA + (
        "distortion = [0.1, -0.2, 0.001, 0, 0.05]\ndeck_z_m = -20\nsea_z_m = 1.5\n"
        "[body_from_camera]\ntranslation_m = [1, 0.5, -0.25]\nquaternion_wxyz = [1, 0, 0, 0]\n"
    )
    mounted = read_camera_file(write(tmp_path, text))
    assert mounted.camera.distortion == (0.1, -0.2, 0.001, 0.0, 0.05)
    assert (mounted.deck_z_m, mounted.sea_z_m) == (-20.0, 1.5)
    assert (mounted.at(None, 0.0).deck_z_m, mounted.at(None, 0.0).sea_z_m) == (-20.0, 0.0)
    np.testing.assert_allclose(mounted.body_from_camera.apply([0.0, 0.0, 2.0]), [1.0, 0.5, 1.75])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (CAMERA + "focal = 3\n", "unknown key focal"),
        (CAMERA + "[body_from_camera]\nroll = 3\n", "body_from_camera: unknown key roll"),
        (CAMERA.replace("fy = 5.0\n", ""), "fy missing"),
        (CAMERA.replace("4.0", "nan"), "fx .*nan"),
        (CAMERA.replace("4.0", "-4.0"), "fx.*-4.0"),
        (CAMERA.replace("= 3", "= 3.5"), "width .*3.5"),
        (CAMERA + "distortion = [1, 2]\n", "distortion .*k6.*2 numbers"),
        (CAMERA + "deck_z_m = '12'\n", "deck_z_m .*'12'"),
        (CAMERA + "sea_z_m = inf\n", "sea_z_m .*inf"),
        (CAMERA + "[body_from_camera]\nquaternion_wxyz = [0, 0, 0, 0]\n", "body_from_camera: quaternion"),
        (CAMERA + "body_from_camera = 3\n", "body_from_camera: .*3"),
        ("width = ", "TOML"),
    ],
)
def test_bad_camera_file_says_what_and_where(tmp_path, text, message):
    with pytest.raises(RecordingError, match=message) as error:
        read_camera_file(write(tmp_path, text))
    assert "camera.toml" in str(error.value)
    assert "\n" not in str(error.value)


finite = st.floats(-1e6, 1e6)


@given(
    st.tuples(st.integers(1, 10000), st.integers(1, 10000)),
    st.tuples(st.floats(1e-3, 1e6), st.floats(1e-3, 1e6), finite, finite),
    st.tuples(finite, finite, finite, finite, finite),
    st.tuples(finite, finite, finite),
    st.integers(0, 2**32),
)
def test_json_round_trip(size, lens, distortion, position, seed):
    camera = Camera(*size, *lens, distortion=distortion)
    mount = RigidTransform.from_components(position, Rotation.random(rng=np.random.default_rng(seed)))
    back = camera_from_mapping(json.loads(json.dumps(camera_to_mapping(camera, mount))), "here")
    assert back.camera.__dict__ == camera.__dict__
    np.testing.assert_allclose(back.body_from_camera.as_matrix(), mount.as_matrix(), atol=1e-12)
