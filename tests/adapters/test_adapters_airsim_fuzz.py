"""Seeded, bounded fuzzing of the wire format over loopback."""

import socket

import msgpack
import numpy as np
import pytest
from airsim_serving import asked, connected, running_server

from deckline.adapters.airsim.methods import METHODS
from deckline.adapters.airsim.protocol import encode_request

ROUNDS, CALLS = 150, 2000
NOT_HERE = ("startRecording",)  # writes to the disk as long as it is on


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    """A server of its own: odd calls leave its clock anywhere, and reset leaves the clock alone."""
    with running_server(tmp_path_factory.mktemp("recordings")) as running:
        yield running


def broken(rng):
    """A call with bytes changed, left out, doubled or put in, or noise altogether."""
    pose = {"position": {"x_val": 1.0}, "orientation": {"w_val": 1.0}}
    calls = [
        ("ping", ()),
        ("simGetImages", ([{"camera_name": "0", "image_type": 0}], "")),
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


def test_broken_bytes_hurt_nobody_else(server):
    rng = np.random.default_rng(20)
    with connected(server.port) as good:
        for _ in range(ROUNDS):
            with connected(server.port) as peer:
                peer.sendall(broken(rng))
                peer.shutdown(socket.SHUT_WR)
                try:
                    while peer.recv(1 << 16):
                        pass
                except ConnectionResetError:
                    continue
            assert asked(good, "ping") == (None, True)
        error, images = asked(good, "simGetImages", [{"camera_name": "0", "image_type": 0}], "")
        assert error is None and images[0]["image_data_uint8"].startswith(b"\x89PNG")
    assert not any("failed" in line for line in server.lines)


def test_odd_parameters_are_answered_and_break_nothing(server):
    rng = np.random.default_rng(21)
    methods = [name for name in METHODS if name not in NOT_HERE]
    refused = 0
    with connected(server.port) as peer:
        for _ in range(CALLS):
            method = methods[rng.integers(len(methods))]
            error, _ = asked(peer, method, *(odd_value(rng) for _ in range(rng.integers(5))))
            refused += error is not None
            assert error is None or "failed in the server" not in error, (method, error)
        assert refused > CALLS // 4
        assert asked(peer, "reset") == (None, None)
        assert asked(peer, "ping") == (None, True)
    assert all(line.isprintable() for line in server.lines)
