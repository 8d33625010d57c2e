"""Connections and their limits, seeded fuzzing over loopback, and the options of `deckline sim --serve`."""

import math
import socket
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path

import msgpack
import numpy as np
import pytest
from airsim_serving import ask, connect, is_closed, open_client, run_server

from deckline.adapters.airsim import HOST, PORT
from deckline.adapters.airsim.protocol import encode_request
from deckline.cli.main import main
from deckline_sim.airsim_server import rpc_server as airsim_server
from deckline_sim.airsim_server.rpc_methods import METHODS
from deckline_sim.airsim_server.rpc_server import is_loopback

pytest.importorskip("cosysairsim")
ROUNDS, CALLS = 100, 1000  # of fuzzing; scripts/fuzz.py does more
LASTING = ("startRecording", "simContinueForTime")  # writes to the disk, or waits for a time that stands still
SERVE = ["sim", "--serve", "--width", "64", "--height", "36"]


def picture(image_type, as_float=False):
    return {"camera_name": "0", "image_type": image_type, "pixels_as_float": as_float}


def test_sixteen_clients_at_once_see_the_same(client, server):
    expected = client.simGetImage("0", 0)

    def take_two(_number):
        with open_client(server.port) as other:
            return [other.simGetImage("0", 0) for _ in range(2)]

    with ThreadPoolExecutor(16) as pool:
        pairs = pool.map(take_two, range(16))
        assert client.ping() is True
        assert [*pairs] == 16 * [[expected, expected]]


def test_more_connections_than_there_may_be_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(airsim_server, "MAX_CONNECTIONS", 2)
    with run_server(tmp_path) as few, connect(few.port) as first, connect(few.port) as second:
        assert ask(first, "ping") == ask(second, "ping") == (None, True)
        with connect(few.port) as third:
            assert is_closed(third)
        assert ask(first, "ping") == (None, True)
        assert " 2 " in few.lines[0]
        second.close()
        for _ in range(100):  # until the server notices that a place is free
            with suppress(ConnectionError), connect(few.port) as again:
                assert ask(again, "ping") == (None, True)
                break
            time.sleep(0.01)
        else:
            raise AssertionError("no place was given back")


def test_many_requests_keep_memory_flat(server):
    requests = [picture(0), picture(1, as_float=True), picture(5)]

    def resident_mib():
        with Path("/proc/self/statm").open() as file:
            return int(file.read().split()[1]) * 4096 / 2**20

    with connect(server.port) as peer:
        for _ in range(20):
            ask(peer, "simGetImages", requests, "")
        before = resident_mib()
        for _ in range(100):
            error, answers = ask(peer, "simGetImages", requests, "")
            assert error is None and len(answers) == 3
        assert resident_mib() - before < 8.0  # 100 times the answers are 12 MiB, the frames behind them 60


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (b"GET / HTTP/1.1\r\n\r\n", "71"),
        (b"\xdd\x7f\xff\xff\xff", "2147483647"),
        (b"\x94\x01\x07\xc0\xc3", ""),
        (encode_request(1, "ping", ())[:-1], ""),
    ],
)
def test_broken_connections_are_named_and_closed(client, server, data, says):
    with connect(server.port) as peer:
        peer.sendall(data)
        peer.shutdown(1)
        assert is_closed(peer)
    assert client.ping() is True
    assert len(server.lines) == 1 and server.lines[0].startswith("127.0.0.1:") and says in server.lines[0]


def test_a_peer_that_takes_no_answer_is_given_up(tmp_path, monkeypatch):
    monkeypatch.setattr(airsim_server, "PATIENCE_S", 0.2)
    images = [picture(1, as_float=True)] * 64
    with run_server(tmp_path) as server, connect(server.port) as peer, connect(server.port) as other:
        peer.sendall(encode_request(1, "simGetImages", (images, "")) * 12)  # 20 MB of answers
        for _ in range(500):
            if server.lines:
                break
            assert ask(other, "ping") == (None, True)
            time.sleep(0.01)
        assert "0.2 s" in server.lines[0]


def test_an_idle_connection_gives_its_place_to_a_new_one(tmp_path, monkeypatch):
    monkeypatch.setattr(airsim_server, "MAX_CONNECTIONS", 2)
    monkeypatch.setattr(airsim_server, "IDLE_S", 0.2)
    with run_server(tmp_path) as few, connect(few.port) as idle, connect(few.port) as busy:
        assert ask(idle, "ping") == (None, True)
        time.sleep(0.3)
        assert ask(busy, "ping") == (None, True)
        with connect(few.port) as third:
            assert ask(third, "ping") == ask(busy, "ping") == (None, True)
        assert is_closed(idle)
        assert "0.2 s" in few.lines[0]


def test_who_leaves_most_unread_goes_first(tmp_path, monkeypatch):
    monkeypatch.setattr(airsim_server, "UNREAD_BYTES", 1_000_000)
    images = [picture(1, as_float=True)] * 64
    with run_server(tmp_path) as server, connect(server.port) as greedy, connect(server.port) as other:
        greedy.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        greedy.sendall(encode_request(1, "simGetImages", (images, "")) * 30)  # of 0.7 MB each
        for _ in range(500):
            error, answers = ask(other, "simGetImages", images, "")
            assert error is None and len(answers) == 64
            if server.lines:
                break
        assert server.lines


@pytest.fixture(scope="module")
def fuzzed(tmp_path_factory):
    """A server of its own: odd calls leave its clock anywhere, and reset leaves the clock alone."""
    with run_server(tmp_path_factory.mktemp("recordings")) as running:
        yield running


def break_call(rng):
    """A call with bytes changed, left out, doubled or put in, or noise altogether."""
    pose = {"position": {"x_val": 1.0}, "orientation": {"w_val": 1.0}}
    calls = [
        ("ping", ()),
        ("simGetImages", ([picture(0)], "")),
        ("simSetVehiclePose", (pose,)),
    ]
    method, params = calls[rng.integers(len(calls))]
    data = bytearray(encode_request(int(rng.integers(2**31)), method, params))
    kind, at = rng.integers(5), int(rng.integers(len(data)))
    if kind == 0:
        data[at] = rng.integers(256)
    elif kind == 1:
        del data[at:]
    elif kind == 2:
        data[at:at] = rng.bytes(int(rng.integers(1, 40)))
    elif kind == 3:
        data *= 2
        del data[at]
    else:
        data = bytearray(rng.bytes(int(rng.integers(1, 400))))
    return bytes(data)


def odd_value(rng, depth=0):
    """A value of a kind that nobody expects there."""
    kinds = [None, True, -1, 2**63, 0.5, float("nan"), float("inf"), "", "0", "\x00\x1b[2J", b"\xff", "front_center"]
    roll = rng.integers(len(kinds) + 3)
    if roll < len(kinds):
        return kinds[roll]
    if depth > 2 or roll == len(kinds):
        return msgpack.ExtType(int(rng.integers(1, 100)), b"x")
    inner = [odd_value(rng, depth + 1) for _ in range(rng.integers(4))]
    names = ("camera_name", "image_type", "position", "orientation", "x_val")
    return inner if roll == len(kinds) + 1 else dict(zip(names, inner, strict=False))


def test_broken_bytes_hurt_nobody_else(fuzzed):
    rng = np.random.default_rng(20)
    with connect(fuzzed.port) as good:
        for _ in range(ROUNDS):
            with connect(fuzzed.port) as peer:
                peer.sendall(break_call(rng))
                peer.shutdown(socket.SHUT_WR)
                assert is_closed(peer)
            assert ask(good, "ping") == (None, True)
        error, images = ask(good, "simGetImages", [picture(0)], "")
        assert error is None and images[0]["image_data_uint8"].startswith(b"\x89PNG")
    assert not any("failed" in line for line in fuzzed.lines)


def test_odd_parameters_are_answered_and_break_nothing(fuzzed):
    rng = np.random.default_rng(21)
    methods = [name for name in METHODS if name not in LASTING]
    refused = 0
    with connect(fuzzed.port) as peer:
        for _ in range(CALLS):
            method = methods[rng.integers(len(methods))]
            error, _ = ask(peer, method, *(odd_value(rng) for _ in range(rng.integers(5))))
            refused += error is not None
            assert error is None or "failed in the server" not in error, (method, error)
        assert refused > CALLS // 4
        ask(peer, "ping")  # may report a refused flight command
        assert ask(peer, "reset") == (None, None)
        assert ask(peer, "ping") == (None, True)
    assert all(line.isprintable() for line in fuzzed.lines)


@pytest.fixture
def served(monkeypatch):
    """The arguments of the server, which does not start."""
    calls = []

    async def remember(*args):
        calls.append(args)

    monkeypatch.setattr(airsim_server, "serve_forever", remember)
    return calls


def test_it_serves_this_machine_alone_in_clear_air_by_default(served, capsys):
    assert main(SERVE) == 0
    ((config, settings, server, _),) = served
    assert (server.host, server.port) == (HOST, PORT) == ("127.0.0.1", 41451)
    assert config.visibility_m == (math.inf, math.inf) and config.depth.range_m == math.inf
    assert settings.cameras["front_center"].capture(0).width == 64
    assert not capsys.readouterr().err


def test_options_reach_the_server(served, tmp_path, capsys):
    file = tmp_path / "settings.json"
    file.write_text('{"ViewMode": "Fpv", "Vehicles": {"Drone1": {}}}')
    words = ["--host", "0.0.0.0", "--port", "0", "--settings", str(file), "--out", str(tmp_path), "--preset", "cvn"]
    assert main([*SERVE, *words, "--visibility", "700"]) == 0
    ((config, settings, server, out),) = served
    assert (server.host, server.port, out) == ("0.0.0.0", 0, tmp_path)
    assert config.preset == "cvn" and config.visibility_m == (700.0, 700.0) and settings.vehicle == "Drone1"
    said = capsys.readouterr().err
    assert "ViewMode" in said and "0.0.0.0" in said
    hosts = ("127.0.0.1", "::1", "localhost", "0.0.0.0", "192.168.1.4", "ship")
    assert [is_loopback(host) for host in hosts] == 3 * [True] + 3 * [False]


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--settings", "nowhere.json"], "nowhere.json"),
        (["--port", "70000"], "70000"),
        (["--contact-sheet", "a.png"], "--contact-sheet"),
        (["--preset", "yacht"], "yacht"),
    ],
)
def test_what_cannot_be_served_is_one_line(words, says, served, capsys):
    try:
        code = main([*SERVE, *words])
    except SystemExit as ended:
        code = ended.code
    assert code != 0 and not served
    said = capsys.readouterr().err
    assert says in said and "Traceback" not in said


def test_a_port_in_use_is_one_line(opengl, capsys):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        assert main([*SERVE, "--port", str(port)]) == 2
    said = capsys.readouterr().err.strip().splitlines()
    assert len(said) == 1 and f"127.0.0.1:{port}" in said[0] and "--port" in said[0]
