import re
from fractions import Fraction
from types import SimpleNamespace

import av
import numpy as np
import pytest
from av.sidedata.sidedata import Type

from deckline.config import Navigation
from deckline.recording import BadFrame, RecordingError, open_recording
from deckline.recording.upright import ONE, read_upright, square_size
from deckline.types import NO_CAMERA, NO_POSE

WIDTH, HEIGHT, COUNT = 64, 48, 12
CAMERA = f"width = {WIDTH}\nheight = {HEIGHT}\nfx = 50\nfy = 50\ncx = 31.5\ncy = 23.5\n"
POSES = "file,time_s,x_m,y_m,z_m,qw,qx,qy,qz\n"


def level(index: int) -> int:
    return 20 + 15 * index


def encode(path, codec, pictures, times=None, lost=(), pix_fmt="yuv420p"):
    """A video of pictures (H, W, 3) at these multiples of 40 ms, without these packets."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=25)
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, pix_fmt
        packets = []
        for time, picture in zip(times or range(len(pictures)), pictures, strict=True):
            frame = av.VideoFrame.from_ndarray(picture, format="rgb24")
            frame.pts, frame.time_base = time, Fraction(1, 25)
            packets += stream.encode(frame)
        packets += stream.encode()
        container.mux([packet for number, packet in enumerate(packets) if number not in lost])
    return path


def flat(*colour):
    return np.full((HEIGHT, WIDTH, 3), colour, np.uint8)


@pytest.fixture
def film(tmp_path):
    """A film at 25 frames/s whose frame n is a flat red of level(n)."""
    return encode(tmp_path / "approach.mp4", "libx264", [flat(level(index), 0, 0) for index in range(COUNT)])


@pytest.fixture
def write_film(tmp_path):
    """Writes a film of flat grey levels at these multiples of 40 ms, without these packets."""

    def write(name, times, lost=()):
        pictures = [flat(level(index)) for index in range(len(times))]
        return encode(tmp_path / name, "mjpeg", pictures, list(times), lost, "yuvj420p")

    return write


def beside(film, **files):
    for name, text in files.items():
        film.with_name(name.replace("__", ".")).write_text(text)
    return film


def test_frames_come_in_order_with_the_films_clock(film):
    source = open_recording(beside(film, camera__toml=CAMERA))
    frames = list(source)
    assert len(source) == len(frames) == COUNT
    assert [frame.file for frame in frames] == [f"approach.mp4#{index}" for index in range(COUNT)]
    np.testing.assert_allclose([frame.time_s for frame in frames], np.arange(COUNT) / 25, atol=1e-6)
    assert source.times().tolist() == [frame.time_s for frame in frames]
    reds = [float(frame.image_rgb[20, 20, 0]) for frame in frames]
    np.testing.assert_allclose(reds, [level(index) for index in range(COUNT)], atol=6)
    assert max(frame.image_rgb[:, :, 2].max() for frame in frames) < 20  # red, not blue
    assert frames[0].world_from_body is None
    assert "no poses.csv" in source.notes[0]


def test_any_frame_can_be_loaded(film):
    source = open_recording(beside(film, camera__toml=CAMERA))
    for index in (7, 8, 2, 11, 0):
        frame = source.load(index)
        assert frame.file == f"approach.mp4#{index}"
        assert abs(float(frame.image_rgb[20, 20, 0]) - level(index)) < 6
    with pytest.raises(IndexError, match=r"11.*12"):
        source.load(12)


def test_poses_go_by_time_between_the_rows(film):
    rows = "".join(f"{10 + 0.4 * n},{n},2,3,1,0,0,0\n" for n in range(2))
    beside(film, camera__toml=CAMERA, poses__csv=POSES.replace("file,", "") + rows)
    source = open_recording(film, navigation=Navigation(offset_s=10.0))
    frames = list(source)
    np.testing.assert_allclose([frame.time_s for frame in frames], 10 + np.arange(COUNT) / 25, atol=1e-6)
    x = [frame.world_from_body.translation[0] for frame in frames[:11]]
    np.testing.assert_allclose(x, np.arange(11) / 10, atol=1e-6)
    assert frames[11].missing is NO_POSE
    assert "1 of 12 pictures have no pose" in source.notes[0]
    with pytest.raises(RecordingError, match=r"10\.000.*10\.400.*0\.000.*0\.440.*--pose-offset-s"):
        open_recording(film)


def test_lost_packets_move_no_poses(write_film):
    film = write_film("film.mkv", range(COUNT), lost=(3, 4, 5))
    rows = "".join(f"{n},{100 + n / 25},{n},0,0,1,0,0,0\n" for n in range(COUNT))
    source = open_recording(beside(film, camera__toml=CAMERA, poses__csv=POSES + rows))
    frames = list(source)
    shown = [round((float(frame.image_rgb[20, 20, 0]) - level(0)) / 15) for frame in frames]
    assert shown == [0, 1, 2, 6, 7, 8, 9, 10, 11]
    np.testing.assert_allclose([frame.world_from_body.translation[0] for frame in frames], shown, atol=1e-6)
    np.testing.assert_allclose([frame.time_s for frame in frames], 100 + np.array(shown) / 25, atol=1e-6)
    assert "drift apart by 0.120 s" in source.notes[0]


def test_a_container_without_times_says_that_lost_packets_move_poses(write_film):
    film = write_film("film.avi", range(COUNT))
    rows = "".join(f"{n},{n / 25},{n},0,0,1,0,0,0\n" for n in range(COUNT))
    source = open_recording(beside(film, camera__toml=CAMERA, poses__csv=POSES + rows))
    assert any("avi stores no times" in note for note in source.notes)


def test_a_variable_rate_keeps_its_times(write_film):
    times = np.array([0, 1, 2, 7, 8, 30])
    film = write_film("film.mkv", times.tolist())
    rows = "".join(f"{t},{t},0,0,1,0,0,0\n" for t in np.arange(0, 1.21, 0.4))
    source = open_recording(beside(film, camera__toml=CAMERA, poses__csv=POSES.replace("file,", "") + rows))
    for index, frame in enumerate(source):
        assert abs(frame.time_s - times[index] / 25) < 1e-6
        assert abs(frame.world_from_body.translation[0] - times[index] / 25) < 1e-6
    np.testing.assert_array_equal(source.load(3).image_rgb, list(source)[3].image_rgb)


def test_a_film_without_times_is_refused(tmp_path):
    path = encode(tmp_path / "film.h264", "libx264", [flat(0)])
    with pytest.raises(RecordingError, match=r"film\.h264.*ffmpeg"):
        open_recording(path)


def test_frame_numbers_must_be_numbers(film):
    with pytest.raises(RecordingError, match=r"line 2: .*'a\.png'"):
        open_recording(beside(film, camera__toml=CAMERA, poses__csv=POSES + "a.png,0,0,0,0,1,0,0,0\n"))


def test_the_camera_file_named_after_the_film_goes_first(film):
    assert open_recording(film).load(0).missing is NO_CAMERA
    beside(film, camera__toml=CAMERA, approach__mp4__camera__toml=CAMERA.replace("fx = 50", "fx = 70"))
    assert open_recording(film).load(0).camera.fx == 70.0


def test_intrinsics_are_scaled_to_pictures_of_the_same_shape_and_refused_for_others(film):
    beside(film, camera__toml=CAMERA.replace("64", "128").replace("48", "96"))
    source = open_recording(film)
    assert (source.load(0).camera.fx, source.load(0).camera.width) == (25.0, WIDTH)
    assert "128x96 px are scaled to the pictures' 64x48" in source.notes[-1]
    beside(film, camera__toml=CAMERA.replace("64", "1280"))
    with pytest.raises(RecordingError, match=r"1280x48 px.* 64x48 px"):
        open_recording(film)


@pytest.fixture
def motion_jpeg(tmp_path):
    """A film whose frames are JPEG pictures of noise, each for itself, and where each begins in the file."""
    pictures = np.random.default_rng(0).integers(0, 256, (COUNT, HEIGHT, WIDTH, 3), dtype=np.uint8)
    path = encode(tmp_path / "film.avi", "mjpeg", list(pictures), pix_fmt="yuvj420p")
    data = path.read_bytes()
    starts = [match.start() for match in re.finditer(rb"\xff\xd8\xff", data)]
    assert len(starts) == COUNT
    return beside(path, camera__toml=CAMERA), data, starts


def test_damaged_picture_is_skipped_and_named(motion_jpeg):
    film, data, starts = motion_jpeg
    size = starts[6] - starts[5] - 16  # up to the header of the next picture's chunk
    film.write_bytes(data[: starts[5]] + bytes(size) + data[starts[5] + size :])
    items = list(open_recording(film).items())
    assert [item.file for item in items] == [f"film.avi#{index}" for index in range(COUNT)]
    assert [index for index, item in enumerate(items) if isinstance(item, BadFrame)] == [5]
    np.testing.assert_allclose([item.time_s for item in items[6:]], np.arange(6, COUNT) / 25, atol=1e-6)


def test_film_cut_short_gives_what_is_whole(motion_jpeg):
    film, data, starts = motion_jpeg
    film.write_bytes(data[: starts[7] + 300])
    source = open_recording(film)
    items = list(source.items())
    assert not any(isinstance(item, BadFrame) for item in items[:7])
    assert all(isinstance(item, BadFrame) for item in items[7:])
    assert len(items) == len(source)


@pytest.mark.parametrize("content", [b"hello", b""])
def test_what_is_no_film_says_so(tmp_path, content):
    path = tmp_path / "approach.mp4"
    path.write_bytes(content)
    with pytest.raises(RecordingError, match=r"approach\.mp4"):
        open_recording(path)


def test_sound_is_no_film(tmp_path):
    path = tmp_path / "sound.mov"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("pcm_s16le", rate=8000)
        frame = av.AudioFrame.from_ndarray(np.zeros((1, 800), np.int16), format="s16", layout="mono")
        frame.sample_rate = 8000
        container.mux(stream.encode(frame))
        container.mux(stream.encode())
    with pytest.raises(RecordingError, match=r"sound\.mov: not a video: it has no picture stream"):
        open_recording(path)


def encode_shown(path, picture, turn_deg=None, pixel_aspect=None):
    """A film of one picture with this display matrix (degrees counter-clockwise) and these pixels."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=25)
        stream.height, stream.width = picture.shape[:2]
        stream.options = {"qp": "1"}
        if turn_deg is not None:
            stream.set_display_rotation(turn_deg)
        if pixel_aspect is not None:
            stream.codec_context.sample_aspect_ratio = pixel_aspect
        packets = stream.encode(av.VideoFrame.from_ndarray(np.ascontiguousarray(picture), format="rgb24"))
        container.mux(packets + stream.encode())
    return path


@pytest.fixture
def corners():
    """A picture (48, 64, 3) whose corners differ in brightness."""
    quarters = np.kron([[30, 90], [150, 210]], np.ones((HEIGHT // 2, WIDTH // 2)))
    return np.repeat(quarters.astype(np.uint8)[:, :, None], 3, axis=2)


@pytest.mark.parametrize("quarters", [1, 2, 3])
def test_pictures_are_turned_as_their_metadata_state(tmp_path, corners, quarters):
    film = encode_shown(tmp_path / "phone.mp4", np.rot90(corners, quarters), turn_deg=-90 * quarters)
    source = open_recording(film, fov_deg=60.0)
    (frame,) = source
    np.testing.assert_allclose(frame.image_rgb.astype(float), corners, atol=6)
    assert (frame.camera.width, frame.camera.height) == (WIDTH, HEIGHT)
    assert any("metadata turn the pictures" in note for note in source.notes)


@pytest.mark.parametrize(("b", "c"), [(0, 0), (1, 1)])
@pytest.mark.parametrize("signs", [(1, 1), (1, -1), (-1, 1), (-1, -1)])
def test_pixels_go_where_the_matrix_puts_them(b, c, signs):
    """All eight matrices, those that mirror included; u' = a u + c v, v' = b u + d v."""
    a, b, c, d = (1 - b) * signs[0], b * signs[0], c * signs[1], (1 - c) * signs[1]
    matrix = np.array([a * ONE, b * ONE, 0, c * ONE, d * ONE, 0, 0, 0, 1 << 30], np.int32).tobytes()
    image = np.arange(18, dtype=np.uint8).reshape(2, 3, 3)
    stored = SimpleNamespace(side_data={Type.DISPLAYMATRIX: matrix}, width=3, height=2, to_ndarray=lambda **_: image)
    v, u = np.indices((2, 3))
    across, down = a * u + c * v, b * u + d * v
    np.testing.assert_array_equal(read_upright(stored, 1.0)[down - down.min(), across - across.min()], image)


def test_other_than_quarter_turns_are_refused(tmp_path, corners):
    film = encode_shown(tmp_path / "phone.mp4", corners, turn_deg=30)
    with pytest.raises(RecordingError, match=r"phone\.mp4.*30 degrees"):
        open_recording(film)


@pytest.mark.parametrize(("aspect", "size"), [(Fraction(4, 3), (85, 48)), (Fraction(3, 4), (64, 64))])
def test_pixels_become_square(tmp_path, corners, aspect, size):
    film = encode_shown(tmp_path / "wide.mp4", corners, pixel_aspect=aspect)
    source = open_recording(film, fov_deg=60.0)
    (frame,) = source
    assert (frame.image_rgb.shape[1], frame.image_rgb.shape[0]) == size
    assert frame.camera.fx == frame.camera.fy
    assert any(f"64x48 px become {size[0]}x{size[1]} px" in note for note in source.notes)


def test_intrinsics_of_pixels_as_stored_are_made_square(tmp_path, corners):
    film = encode_shown(tmp_path / "wide.mp4", corners, pixel_aspect=Fraction(4, 3))
    (frame,) = open_recording(beside(film, camera__toml=CAMERA))
    np.testing.assert_allclose([frame.camera.fx, frame.camera.fy], [50 * 85 / 64, 50])


def test_pixels_too_wide_are_refused_before_they_are_made():
    with pytest.raises(ValueError, match="3840000x48 px"):
        square_size(WIDTH, HEIGHT, 60000.0)
