import json
import zipfile
from pathlib import Path

import cv2
import numpy as np
import onnx
import pytest
from skimage.metrics import peak_signal_noise_ratio

import deckline
from deckline.app.cli import main
from deckline.app.eval_dehazing_cost import CostTask, measure_costs, run_once
from deckline.app.eval_dehazing_methods import build_dehazer, by_name
from deckline.app.eval_dehazing_pairs import open_pairs
from deckline.app.eval_dehazing_rows import ROWS
from deckline.dehaze import DarkChannelDehazer
from deckline.geometry import Camera, pose
from deckline.haze import add_haze, beta_from_visibility
from deckline.recording import RecordingWriter, open_source
from deckline.runtime import shipped_weights
from deckline.runtime.session import METADATA_KEY
from deckline.types import Frame, Truth

CAMERA = Camera.from_fov(64, 48, np.pi / 3)
VISIBILITY_M = (250.0, 250.0, 800.0, 5000.0)
HORIZON_ROW = 16


def pictures(index: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Clear and hazy picture, and depth: NaN in the sky, ever nearer below it."""
    clear = np.random.default_rng(index).integers(20, 150, (48, 64, 3)).astype(np.uint8)
    depth = np.full((48, 64), np.nan, np.float32)
    depth[HORIZON_ROW:] = (4000.0 / np.arange(1, 48 - HORIZON_ROW + 1))[:, None]
    hazy = add_haze(clear, depth, beta_from_visibility(VISIBILITY_M[index]), (200.0, 205.0, 210.0))
    return clear, hazy, depth


def write_recording(folder: Path, clear_too: bool = True) -> Path:
    with RecordingWriter(folder) as writer:
        for index, visibility_m in enumerate(VISIBILITY_M):
            clear, hazy, depth = pictures(index)
            truth = Truth(visibility_m=visibility_m, clear_rgb=clear if clear_too else None)
            at = pose([-500.0, 0.0, -40.0], [1, 0, 0, 0])
            writer.add(
                Frame(
                    "x.png", float(index), hazy, CAMERA, depth_m=depth, world_from_body=at, deck_z_m=-20.0, truth=truth
                )
            )
    return folder


@pytest.fixture
def recording(tmp_path) -> Path:
    return write_recording(tmp_path / "recording")


def run(*args: object) -> int:
    return main(["eval", "dehazing", *map(str, args)])


def measured(path: Path, *args: object) -> dict:
    assert run(*args, "--json", path) == 0
    return json.loads(path.read_text())


def last_error(capsys) -> str:
    return capsys.readouterr().err.strip().splitlines()[-1]


def rows_of(folder: Path) -> list[dict]:
    return [json.loads(line) for line in (folder / ROWS).read_text().splitlines()]


def test_rows_agree_with_a_direct_computation(recording, tmp_path, capsys):
    out = tmp_path / "out"
    found = measured(tmp_path / "f.json", recording, "--dehazer", "dark-channel", "--detector", "none", "--out", out)
    dark = DarkChannelDehazer()
    expected = {"none": [], "dark-channel": []}
    for index in range(4):
        clear, hazy, _ = pictures(index)
        for name, image in (("none", hazy), ("dark-channel", dark(hazy))):
            whole = peak_signal_noise_ratio(clear, image)
            expected[name].append((whole, peak_signal_noise_ratio(clear[HORIZON_ROW:], image[HORIZON_ROW:])))
    rows = rows_of(out)
    assert [row["dehazer"] for row in rows] == ["none", "dark-channel"] * 4
    for name, values in expected.items():
        mine = [(row["psnr_db"], row["psnr_db_surface"]) for row in rows if row["dehazer"] == name]
        np.testing.assert_allclose(mine, values, atol=1e-9)
        means = found["visibility"]["all"][name]["means"]
        assert [means["psnr_db"], means["psnr_db_surface"]] == pytest.approx(np.mean(values, axis=0))
    difference = found["visibility"]["all"]["dark-channel"]["differences"]["psnr_db"]
    gains = np.subtract(expected["dark-channel"], expected["none"])[:, 0]
    assert difference["value"] == pytest.approx(gains.mean())
    assert gains.min() <= difference["low"] <= difference["value"] <= difference["high"] <= gains.max()
    assert list(found["visibility"]) == ["all", "150-300 m", "500-1000 m", "3000+ m"]
    assert found["visibility"]["150-300 m"]["none"]["images"] == 2
    assert found["size"] == {"none": None, "dark-channel": None}
    text = capsys.readouterr().out
    assert "below horizon, dB" in text and "Lines" not in text and f"deckline {deckline.__version__}" in text


def test_every_other_pair_and_the_markdown_of_the_same_numbers(recording, tmp_path):
    file = tmp_path / "t.md"
    arguments = ("--detector", "none", "--every", 2, "--dehazer", "none", "--markdown", file)
    found = measured(tmp_path / "f.json", recording, *arguments)
    means = found["visibility"]["all"]["none"]
    assert means["images"] == 2
    row = next(line for line in file.read_text().splitlines() if line.startswith("| none | 2 |"))
    assert row.split(" | ")[2] == f"{means['means']['psnr_db']:.2f}"
    assert "| 500-1000 m | none | 1 |" in file.read_text()


def test_dehazers_never_see_truth_and_see_depth_when_told(recording):
    for with_depth in (False, True):
        frame = open_pairs(recording, with_depth=with_depth).load("0").frame
        assert frame.truth is None
        assert (frame.depth_m is not None) is with_depth


def test_a_stopped_command_goes_on_and_gives_the_same_numbers(recording, tmp_path, monkeypatch):
    arguments = (recording, "--detector", "none", "--dehazer", "dark-channel")
    whole = measured(tmp_path / "whole.json", *arguments)
    out, calls = tmp_path / "out", []
    inside = DarkChannelDehazer.__call__

    def stopped(self, image_rgb):
        calls.append(1)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return inside(self, image_rgb)

    with monkeypatch.context() as patch:
        patch.setattr(DarkChannelDehazer, "__call__", stopped)
        assert run(*arguments, "--out", out) == 130
    assert len(rows_of(out)) == 5
    with (out / ROWS).open("a") as file:
        file.write('{"source": "half a l')
    with monkeypatch.context() as patch:
        patch.setattr(DarkChannelDehazer, "__call__", lambda self, image: calls.append(1) or inside(self, image))
        resumed = measured(tmp_path / "resumed.json", *arguments, "--out", out)
    assert len(calls) == 3 + 2
    assert len(rows_of(out)) == 8
    assert resumed == whole
    assert measured(tmp_path / "again.json", *arguments, "--out", out) == whole


def test_more_dehazers_are_added_and_rows_of_other_settings_refused(recording, tmp_path, capsys):
    out = tmp_path / "out"
    assert run(recording, "--detector", "none", "--dehazer", "none", "--out", out) == 0
    before = (out / ROWS).read_text()
    found = measured(tmp_path / "f.json", recording, "--detector", "none", "--dehazer", "dark-channel", "--out", out)
    assert list(found["visibility"]["all"]) == ["none", "dark-channel"]
    assert (out / ROWS).read_text().startswith(before) and len(rows_of(out)) == 8
    for more, what in ((("--every", 3), "every"), (("--with-depth",), "with_depth"), (("--deck-z-m", -5), "deck_z_m")):
        assert run(recording, "--detector", "none", "--dehazer", "none", "--out", out, *more) == 2
        assert f"holds rows measured with another {what}" in last_error(capsys)
    (out / ROWS).write_text('{"file": "guidance of another command"}\n')
    assert run(recording, "--detector", "none", "--dehazer", "none", "--out", out) == 2
    assert "a line is no row of this command" in last_error(capsys)


def test_a_damaged_frame_is_skipped_counted_and_named(recording, tmp_path, capsys):
    second = sorted((recording / "images").glob("*.png"), key=lambda path: path.stat().st_mtime_ns)[1]
    second.write_bytes(second.read_bytes()[:100])
    found = measured(tmp_path / "f.json", recording, "--detector", "none", "--dehazer", "none")
    assert found["visibility"]["all"]["none"]["images"] == 3
    assert len(found["skipped"]) == 1 and second.name in found["skipped"][0][0]
    assert "1 frames skipped; the first:" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--dehazer", "magic"), "unknown dehazer 'magic': use one of none, dark-channel"),
        (("--dehazer", "nowhere.onnx"), "nowhere.onnx does not exist"),
        (("--reference", "magic"), "unknown dehazer 'magic'"),
        (("--detector", "magic"), "unknown detector 'magic'"),
        (("--every", "0"), "every must be 1 or more, got 0"),
        (("--cost-size", "0", "8"), "cost_size must be 1 or more, got 0"),
    ],
)
def test_bad_options_are_one_line(recording, arguments, message, capsys):
    assert run(recording, *arguments) == 2
    error = capsys.readouterr().err.strip().splitlines()
    assert len(error) == 1 and message in error[0]


def test_sources_without_clear_pictures_are_one_line(tmp_path, capsys):
    assert run(write_recording(tmp_path / "hazy", clear_too=False), "--detector", "none") == 2
    assert "no clear pictures to compare with" in last_error(capsys)
    assert run(tmp_path / "nothing", "--detector", "none") == 2
    assert "there is no such file or folder" in last_error(capsys)
    assert run("--detector", "none") == 2
    assert "give at least one recording" in last_error(capsys)


def test_a_recording_of_which_no_frame_is_left_is_one_line(recording, capsys):
    for path in (recording / "clear").glob("*"):
        path.unlink()
    assert run(recording, "--detector", "none", "--dehazer", "none") == 2
    error = last_error(capsys)
    assert "zero frames: none of 4 could be used; the first:" in error and "clear" in error


def test_two_files_of_one_name_are_refused(tmp_path):
    for folder in ("a", "b"):
        (tmp_path / folder / "net").mkdir(parents=True)
    files = [str(tmp_path / folder / "net" / "dehaze.onnx") for folder in ("a", "b")]
    assert by_name(["none", files[0], files[0]]) == {"none": "none", "net": files[0]}
    with pytest.raises(ValueError, match="would both be called net"):
        by_name(files)


def write_network(path: Path) -> Path:
    """A network without a coarse grid that gives the picture back, trained on pictures 32 px wide, so to say."""
    sizes = [1, 3, "height", "width"]
    values = [onnx.helper.make_tensor_value_info(name, onnx.TensorProto.FLOAT, sizes) for name in ("image", "clear")]
    graph = onnx.helper.make_graph(
        [onnx.helper.make_node("Identity", ["image"], ["clear"])], "g", values[:1], values[1:]
    )
    model = onnx.helper.make_model(graph, opset_imports=[onnx.helper.make_opsetid("", 18)], ir_version=8)
    config = {"kind": "dehaze", "network": {"unshuffle": 1}, "working_long_side_px": 32}
    entry = model.metadata_props.add()
    entry.key, entry.value = METADATA_KEY, json.dumps(config | {"parameters": 484_000, "macs_256": 2_600_000_000})
    path.parent.mkdir()
    onnx.save(model, path)
    return path


def test_full_size_networks_see_the_whole_picture_and_coarse_ones_what_they_are_made_for(tmp_path):
    path = str(write_network(tmp_path / "net" / "dehaze.onnx"))
    image = pictures(0)[0]
    assert not np.array_equal(build_dehazer(path)(image), image)
    np.testing.assert_array_equal(build_dehazer(path, full_size=True)(image), image)
    shipped = str(shipped_weights("dehaze"))
    used = build_dehazer(shipped)
    assert used.coarse
    assert build_dehazer(shipped, full_size=True).working_long_side_px == used.working_long_side_px


def test_a_network_is_called_after_its_folder_and_its_size_is_shown(recording, tmp_path, capsys):
    path = write_network(tmp_path / "net" / "dehaze.onnx")
    found = measured(tmp_path / "f.json", recording, "--detector", "none", "--full-size", "--dehazer", path)
    assert found["size"] == {"none": None, "net": {"parameters": 484_000, "macs_256": 2_600_000_000}}
    assert found["visibility"]["all"]["net"]["differences"]["psnr_db"]["value"] == 0.0
    text = capsys.readouterr().out
    assert "0.484 M" in text and "2.60 G" in text


# A labelled folder: a frame of the shipped sample, and the same in more haze.


@pytest.fixture(scope="module")
def pair_folder(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("pairs")
    sample = folder / "sample"
    with zipfile.ZipFile(Path(deckline.__file__).parent / "sample" / "approach.zip") as file:
        file.extractall(sample)
    source = open_source(sample)
    frame = source.load(len(source) - 1)
    hazy = np.clip(0.7 * frame.image_rgb + 0.3 * 190.0, 0, 255).astype(np.uint8)
    for name, image in (("a_clear.png", frame.image_rgb), ("a_vis900.png", hazy)):
        cv2.imwrite(str(folder / name), cv2.cvtColor(image, cv2.COLOR_RGB2BGR))
    camera = frame.camera
    keys = ("width", "height", "fx", "fy", "cx", "cy")
    (folder / "camera.toml").write_text("".join(f"{key} = {getattr(camera, key)}\n" for key in keys))
    position, rotation = frame.world_from_body.as_components()
    numbers = [*position, *rotation.as_quat(scalar_first=True)]
    rows = [",".join([name, "0", *map(repr, map(float, numbers))]) for name in ("a_clear.png", "a_vis900.png")]
    (folder / "poses.csv").write_text("\n".join(["file,time_s,x_m,y_m,z_m,qw,qx,qy,qz", *rows]) + "\n")
    optical = frame.world_from_camera.inv()
    ends = {
        side: camera.project(optical.apply(np.stack([line.p0_m, line.p1_m])))
        for side, line in (("left", frame.truth.left), ("right", frame.truth.right))
    }
    assert np.all(np.isfinite(list(ends.values())))
    lines = {f"{side}_px": pixels.tolist() for side, pixels in ends.items()}
    frames = [
        {"file": "a_clear.png", "pair_of": None, "visibility_m": 20000, **lines},
        {"file": "a_vis900.png", "pair_of": "a_clear.png", "visibility_m": 900, **lines},
    ]
    (folder / "labels.json").write_text(json.dumps({"frames": frames}))
    (folder / "deck_z").write_text(repr(frame.deck_z_m))
    return folder


def test_pairs_of_a_labelled_folder_and_their_lines_with_the_shipped_detector(pair_folder, tmp_path, capsys):
    deck_z_m = float((pair_folder / "deck_z").read_text())
    found = measured(tmp_path / "f.json", pair_folder, "--dehazer", "none", f"--deck-z-m={deck_z_m}")
    (band,) = set(found["visibility"]) - {"all"}
    summary = found["visibility"]["500-1000 m"]["none"]
    assert band == "500-1000 m" and summary["images"] == summary["asked"] == 1
    clear, hazy = (cv2.imread(str(pair_folder / name)) for name in ("a_clear.png", "a_vis900.png"))
    assert summary["means"]["psnr_db"] == pytest.approx(peak_signal_noise_ratio(clear, hazy), abs=1e-9)
    assert "psnr_db_surface" not in summary["means"]  # nothing says where sea and ship are
    assert summary["lines"]["found_rate"] == 1.0
    assert summary["lines"]["point_error_px.median"] < 1.5
    text = capsys.readouterr().out
    assert "Lines by visibility" in text and "below horizon" not in text.split("\n\n")[0].split("PSNR and SSIM")[0]


def test_bad_labels_and_pairs_are_named(pair_folder, tmp_path, capsys):
    labels = json.loads((pair_folder / "labels.json").read_text())
    folder = tmp_path / "copy"
    folder.mkdir()
    for name in ("a_clear.png", "a_vis900.png", "camera.toml", "poses.csv"):
        (folder / name).write_bytes((pair_folder / name).read_bytes())
    hazy = labels["frames"][1]
    for change, message in (
        ({"pair_of": "../x.png"}, "pair_of must name the clear image in this folder"),
        ({"visibility_m": "thick"}, "visibility_m must be positive metres"),
        ({"file": "b.png"}, "there is no image b.png"),
        ({"pair_of": "gone.png"}, "its clear picture gone.png"),
        ({"pair_of": None}, "zero frames: no hazy and clear pair"),
    ):
        (folder / "labels.json").write_text(json.dumps({"frames": [labels["frames"][0], hazy | change]}))
        assert run(folder, "--detector", "none", "--dehazer", "none") == 2
        assert message in last_error(capsys)
    (folder / "labels.json").write_text(json.dumps(labels))
    cv2.imwrite(str(folder / "a_clear.png"), np.zeros((30, 40, 3), np.uint8))
    assert run(folder, "--detector", "none", "--dehazer", "none") == 2
    assert "its clear picture is 40x30 px" in last_error(capsys)


# Cost. Times are only shown; the memory of a copy is known.


def test_a_copy_takes_the_memory_of_a_picture_in_a_fresh_process(recording):
    task = CostTask("none", str(recording), "0", (2000, 1000), False, None)
    steps = []
    costs, failed = measure_costs({"none": task}, 1, lambda: steps.append(1))
    assert not failed and len(steps) == 1
    assert costs["none"].seconds > 0
    assert 6e6 * 0.9 < costs["none"].peak_bytes < 6e6 * 1.5  # 2000 x 1000 x 3 bytes


def test_what_cannot_be_measured_says_why(recording):
    task = CostTask("gone.onnx", str(recording), "0", (64, 48), False, None)
    costs, failed = measure_costs({"gone": task}, 2, lambda: None)
    assert costs == {} and "gone.onnx does not exist" in failed["gone"]


def test_cost_is_printed_with_its_ratio_to_the_reference(recording, tmp_path, monkeypatch):
    monkeypatch.setattr("deckline.app.eval_dehazing_cost._in_process", run_once)
    file = tmp_path / "t.md"
    arguments = ("--dehazer", "dark-channel", "--reference", "dark-channel", "--cost", "--cost-runs", 1)
    found = measured(
        tmp_path / "f.json", recording, "--detector", "none", *arguments, "--cost-size", 64, 48, "--markdown", file
    )
    assert set(found["cost"]) == {"none", "dark-channel"} and found["cost_size_px"] == [64, 48]
    row = next(line for line in file.read_text().splitlines() if line.startswith("| dark-channel |"))
    assert "(1.00)" in row
    ratio = found["cost"]["none"]["seconds"] / found["cost"]["dark-channel"]["seconds"]
    assert f"({ratio:.2f})" in file.read_text()
