import subprocess
import sys
from contextlib import closing

import av
import numpy as np
import pytest

from deckline.report.video import KEY_EVERY, MAX_STEP_S, VideoPiece, count_pictures, join

SIZE = (96, 64)


def picture(grey: int) -> np.ndarray:
    return np.full((SIZE[1], SIZE[0], 3), grey, dtype=np.uint8)


def write(path, greys, step_s=0.1):
    with closing(VideoPiece(path, SIZE)) as piece:
        for number, grey in enumerate(greys):
            piece.add(picture(grey), number * step_s)


def shown(path) -> tuple[list[int], list[float]]:
    with av.open(str(path)) as container:
        frames = [(round(float(f.to_ndarray(format="rgb24").mean())), f.time) for f in container.decode(video=0)]
    return [grey for grey, _ in frames], [time for _, time in frames]


def test_pieces_are_joined_in_order_and_in_real_time(tmp_path):
    write(tmp_path / "a.mp4", [20, 60, 100])
    write(tmp_path / "b.mp4", [140, 180])
    assert join([tmp_path / "a.mp4", tmp_path / "b.mp4"], tmp_path / "film.mp4") == 5
    greys, times = shown(tmp_path / "film.mp4")
    assert np.allclose(greys, [20, 60, 100, 140, 180], atol=3)
    assert np.allclose(times, [0.0, 0.1, 0.2, 0.3, 0.4], atol=1e-3)


def test_the_film_is_what_browsers_play_with_its_index_first(tmp_path):
    write(tmp_path / "a.mp4", [20, 60])
    join([tmp_path / "a.mp4"], tmp_path / "film.mp4")
    data = (tmp_path / "film.mp4").read_bytes()
    assert 0 < data.find(b"moov") < data.find(b"mdat")
    with av.open(str(tmp_path / "film.mp4")) as container:
        stream = container.streams.video[0]
        assert (stream.codec_context.name, stream.pix_fmt) == ("h264", "yuv420p")
        assert (stream.width, stream.height) == SIZE


def test_pauses_are_shortened_and_steps_back_survived(tmp_path):
    with closing(VideoPiece(tmp_path / "a.mp4", SIZE)) as piece:
        for time_s in (0.0, 100.0, 50.0):
            piece.add(picture(90), time_s)
    _, times = shown(tmp_path / "a.mp4")
    assert times[1] == pytest.approx(MAX_STEP_S)
    assert times[2] > times[1]


def test_a_piece_cut_short_still_gives_its_whole_pictures(tmp_path):
    write(tmp_path / "a.mp4", list(range(20, 20 + 3 * KEY_EVERY)))
    data = (tmp_path / "a.mp4").read_bytes()
    (tmp_path / "a.mp4").write_bytes(data[: len(data) * 2 // 3])
    count = count_pictures(tmp_path / "a.mp4")
    assert 0 < count < 3 * KEY_EVERY
    assert join([tmp_path / "a.mp4"], tmp_path / "film.mp4") == count
    assert len(shown(tmp_path / "film.mp4")[0]) == count


def test_no_pictures_make_no_film(tmp_path):
    with closing(VideoPiece(tmp_path / "empty.mp4", SIZE)):
        pass
    (tmp_path / "rubbish.mp4").write_bytes(b"this is no film")
    assert join([tmp_path / "empty.mp4", tmp_path / "rubbish.mp4"], tmp_path / "film.mp4") == 0
    assert not (tmp_path / "film.mp4").exists()


def test_a_killed_writer_leaves_at_most_one_group_of_pictures_unwritten(tmp_path):
    script = f"""
import os, numpy as np
from pathlib import Path
from deckline.report.video import VideoPiece
piece = VideoPiece(Path({str(tmp_path / "a.mp4")!r}), {SIZE})
for n in range(100):
    piece.add(np.full(({SIZE[1]}, {SIZE[0]}, 3), n, dtype=np.uint8), n / 10)
os._exit(9)
"""
    assert subprocess.run([sys.executable, "-c", script], check=False).returncode == 9
    encoder_holds = 16  # pictures: frame threads of the encoder
    assert count_pictures(tmp_path / "a.mp4") >= 100 - 2 * KEY_EVERY - encoder_holds
