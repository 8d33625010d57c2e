"""`deckline land`."""

import json

import av
import pytest

from deckline.cli.main import main
from deckline_lab.campaigns import filmed
from deckline_lab.cli import land
from deckline_sim.landing.film import FILM_PX
from deckline_sim.scene.gl import RendererError

QUICK = ("--sight", "guidance", "--start-m", "300", "--visibility-m", "inf", "--seed", "2")
FILES = ("landing.json", "landing.mp4", "report.html")


@pytest.fixture
def film_of_few(monkeypatch):
    """Landings whose films show the last two samples alone."""
    pytest.importorskip("jsbsim")
    fly = land.fly_filmed

    def shorten(config, seed):
        flown = fly(config, seed)
        object.__setattr__(flown.landing, "samples", flown.landing.samples[-2:])
        return flown

    monkeypatch.setattr(land, "fly_filmed", shorten)


def test_land_writes_film_report_and_record(opengl, film_of_few, tmp_path, capsys):
    pytest.importorskip("matplotlib")
    out = tmp_path / "out"
    assert main(["land", *QUICK, "--camera.rate-hz", "20", "--out", str(out)]) == 0
    printed = capsys.readouterr().out.splitlines()
    assert printed[1:] == [str(out / name) for name in ("landing.json", "landing.mp4", "report.html")]
    record = json.loads((out / "landing.json").read_text())
    assert record["outcome"].replace("_", "-").split("-")[0] in printed[0]
    assert record["settings"]["camera"]["rate_hz"] == 20
    assert record["settings"]["start_m"] == 300
    with av.open(str(out / "landing.mp4")) as film:
        stream = film.streams.video[0]
        assert (stream.width, stream.height) == FILM_PX
    assert 'src="landing.mp4"' in (out / "report.html").read_text()
    assert sorted(path.name for path in out.iterdir()) == sorted(FILES)


@pytest.mark.parametrize(
    ("flags", "words"),
    [
        (("--aircraft", "f15"), ("aircraft", "f15")),
        (("--ship", "runway"), ("ship", "runway")),
        (("--visibility-m", "-3"), ("visibility_m", "-3")),
        (("--fault", "no such fault", "--sight", "points"), ("no such fault",)),
    ],
)
def test_one_line_for_a_landing_that_cannot_be_flown(flags, words, tmp_path, capsys):
    pytest.importorskip("jsbsim")
    assert main(["land", *flags, "--out", str(tmp_path / "out")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert all(word in line for word in words)
    assert not (tmp_path / "out").exists()


def test_nothing_is_written_without_opengl(film_of_few, monkeypatch, tmp_path, capsys):
    def refuse(config, scene):
        raise RendererError("no OpenGL through EGL on this machine")

    monkeypatch.setattr(filmed, "open_simulator", refuse)
    assert main(["land", *QUICK, "--out", str(tmp_path / "out")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "EGL" in line
    assert not list(tmp_path.iterdir())


def test_an_interrupted_film_leaves_nothing(film_of_few, monkeypatch, tmp_path, capsys):
    def interrupt(landing, take, path):
        path.write_bytes(b"half a film")
        raise KeyboardInterrupt

    class Simulator:
        flown_frame = None

        def close(self):
            pass

    monkeypatch.setattr(filmed, "write_film", interrupt)
    monkeypatch.setattr(filmed, "open_simulator", lambda config, scene: Simulator())
    assert main(["land", *QUICK, "--out", str(tmp_path / "out")]) == 130
    assert not list(tmp_path.iterdir())
