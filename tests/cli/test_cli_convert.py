import re

import cv2
import numpy as np
import pytest

from deckline.cli.main import main
from deckline.recording import open_recording

HEADER = "VehicleName\tTimeStamp\tPOS_X\tPOS_Y\tPOS_Z\tQ_W\tQ_X\tQ_Y\tQ_Z\tImageFile\n"


@pytest.fixture
def folder(tmp_path):
    """A plain AirSim recording of one frame of 16x8 px."""
    (tmp_path / "a" / "images").mkdir(parents=True)
    (tmp_path / "a" / "airsim_rec.txt").write_text(HEADER + "D\t100\t0\t0\t-30\t1\t0\t0\t0\timg_D_0_0_1.png\n")
    cv2.imwrite(str(tmp_path / "a" / "images" / "img_D_0_0_1.png"), np.full((8, 16, 3), 90, np.uint8))
    return tmp_path / "a"


def test_options_of_the_camera_arrive_in_the_converted_recording(folder, tmp_path, capsys):
    options = ["--fov-deg", "60", "--mount-m", "0.5", "0", "0.1", "--mount-deg", "0", "-10", "0", "--deck-z-m", "-18"]
    assert main(["convert", str(folder), "--out", str(tmp_path / "b"), *options]) == 0
    assert "b: 1 rows, 1 image files" in capsys.readouterr().out
    frame = open_recording(tmp_path / "b").load(0)
    assert frame.camera.fx == pytest.approx(8 / np.tan(np.pi / 6))
    assert frame.deck_z_m == -18.0
    assert frame.body_from_camera.translation.tolist() == [0.5, 0.0, 0.1]
    view = frame.body_from_camera.rotation.apply([0.0, 0.0, 1.0])
    np.testing.assert_allclose(view, [np.cos(np.pi / 18), 0.0, np.sin(np.pi / 18)], atol=1e-12)  # looks down
    assert main(["convert", str(tmp_path / "b"), "--out", str(tmp_path / "c"), "--plain"]) == 0
    assert not (tmp_path / "c" / "scene.json").exists()


@pytest.mark.parametrize(
    ("options", "names"),
    [
        (["--plain", "--deck-z-m", "1"], "--plain"),
        (["--camera", "c.toml", "--mount-m", "1", "0", "0"], "--mount-m"),
        (["--plain"], r"scene\.json"),
    ],
)
def test_wrong_options_are_one_line(folder, tmp_path, capsys, options, names):
    assert main(["convert", str(folder), "--out", str(tmp_path / "b"), *options]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert re.search(names, line)
    assert not (tmp_path / "b").exists()
