import math
import socket

import pytest

from deckline.adapters.airsim import HOST, PORT
from deckline.adapters.airsim import server as airsim_server
from deckline.adapters.airsim.serve import ServeConfig, is_loopback
from deckline.cli.main import main
from deckline.sim import RendererError
from deckline.sim.scene.gl import open_context

SERVE = ["sim", "--serve", "--width", "64", "--height", "36"]


@pytest.fixture
def asked(monkeypatch):
    """What would be served, without serving it."""
    calls = []
    monkeypatch.setattr(airsim_server, "serve", lambda *args: calls.append(args))
    return calls


@pytest.mark.parametrize(
    ("host", "loopback"),
    [
        ("127.0.0.1", True),
        ("::1", True),
        ("localhost", True),
        ("0.0.0.0", False),
        ("192.168.1.4", False),
        ("ship", False),
    ],
)
def test_loopback_is_known(host, loopback):
    assert is_loopback(host) is loopback


def test_it_serves_this_machine_alone_in_clear_air_unless_told(asked, capsys):
    assert main(SERVE) == 0
    ((config, settings, server),) = asked
    assert (server.host, server.port) == (HOST, PORT) == ("127.0.0.1", 41451)
    assert config.visibility_m == (math.inf, math.inf) and config.depth.range_m == math.inf
    assert settings.cameras["front_center"].capture(0).width == 64
    assert not capsys.readouterr().err


def test_options_reach_the_server(asked, tmp_path, capsys):
    file = tmp_path / "settings.json"
    file.write_text('{"ClockSpeed": 2, "Vehicles": {"Drone1": {}}}')
    words = ["--host", "0.0.0.0", "--port", "0", "--settings", str(file), "--out", str(tmp_path), "--preset", "cvn"]
    assert main([*SERVE, *words, "--visibility", "700"]) == 0
    ((config, settings, server),) = asked
    assert (server.host, server.port, server.out) == ("0.0.0.0", 0, tmp_path)
    assert config.preset == "cvn" and config.visibility_m == (700.0, 700.0) and settings.vehicle == "Drone1"
    said = capsys.readouterr().err
    assert "without effect here: ClockSpeed" in said and "whoever reaches this machine" in said


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--settings", "nowhere.json"], "nowhere.json"),
        (["--port", "70000"], "port must lie between 0 and 65535, got 70000"),
        (["--contact-sheet", "a.png"], "--serve or --contact-sheet, not both"),
        (["--preset", "yacht"], "yacht"),
    ],
)
def test_what_cannot_be_served_is_one_line(words, says, asked, capsys):
    try:
        code = main([*SERVE, *words])
    except SystemExit as ended:
        code = ended.code
    assert code != 0 and not asked
    said = capsys.readouterr().err
    assert says in said and "Traceback" not in said


def test_a_port_in_use_is_one_line(capsys):
    try:
        open_context().release()
    except RendererError as error:
        pytest.skip(f"no OpenGL on this machine: {error}")
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        assert main([*SERVE, "--port", str(port)]) == 2
    said = capsys.readouterr().err.strip().splitlines()
    assert len(said) == 1 and f"cannot listen on 127.0.0.1:{port}" in said[0] and "choose --host or --port" in said[0]


def test_ports_are_checked():
    with pytest.raises(ValueError, match="port must lie between"):
        ServeConfig(port=-1)
