import socket
import threading
from contextlib import ExitStack

import msgpack
import numpy as np
import pytest
from airsim_stand_in import StandIn, pose

from deckline.adapters.airsim.client import (
    CallError,
    Connection,
    ConnectionLostError,
    StoppedError,
    get_camera,
    get_images,
    get_vehicle_pose,
    parse_address,
)


@pytest.fixture
def connect():
    """A stand-in with these methods, and a connection to it; both are closed when the test ends."""
    with ExitStack() as stack:

        def connect_to(options=None, **methods):
            server = stack.enter_context(StandIn(**methods))
            return stack.enter_context(Connection("127.0.0.1", server.port, **(options or {}))), server

        yield connect_to


@pytest.mark.parametrize(
    ("address", "parts"),
    [
        ("airsim://127.0.0.1:41451", ("127.0.0.1", 41451, "")),
        ("airsim://localhost", ("localhost", 41451, "")),
        ("airsim://[::1]:7/Drone1", ("::1", 7, "Drone1")),
    ],
)
def test_an_address_names_host_port_and_vehicle(address, parts):
    assert parse_address(address) == parts


@pytest.mark.parametrize("address", ["airsim://", "airsim:x", "http://a:1", "airsim://a:x", "airsim://a:99999", "a:1"])
def test_a_wrong_address_is_named(address):
    with pytest.raises(ValueError, match=address.replace("//", "/?/?")):
        parse_address(address)


def test_an_error_of_the_server_is_one_line_and_leaves_the_connection_open(connect):
    def refuse(*_params):
        raise ValueError("no such\ncamera")

    connection, _ = connect(simGetCameraInfo=refuse)
    with pytest.raises(CallError, match=r"^simGetCameraInfo: no such\\ncamera$"):
        get_camera(connection, "9", "")
    assert get_vehicle_pose(connection, "").translation.tolist() == [1.0, 2.0, -3.0]


def test_nobody_there_is_lost_and_says_where():
    with socket.create_server(("127.0.0.1", 0)) as listening:
        port = listening.getsockname()[1]
    with pytest.raises(ConnectionLostError, match=f"127.0.0.1:{port}"):
        Connection("127.0.0.1", port)


@pytest.mark.parametrize(
    ("came", "text"),
    [
        (b"HTTP/1.1 400 Bad Request\r\n\r\n", r"127\.0\.0\.1:\d+.*72"),
        (b"\x94\x01\x01\xc0", r"127\.0\.0\.1:\d+"),  # cut short
        (msgpack.packb([1, 99, None, 0]), "99.*1"),
        (b"\xc1", r"127\.0\.0\.1:\d+"),
    ],
)
def test_what_is_no_answer_loses_the_connection(came, text, connect):
    connection, _ = connect(ping=lambda: came)
    with pytest.raises(ConnectionLostError, match=text):
        connection.call("ping")


def test_silence_ends_after_its_time_and_a_stop_ends_it_before(connect):
    hold, stopped = threading.Event(), threading.Event()
    connection, _ = connect({"timeout_s": 0.3}, ping=lambda: hold.wait(20))
    with pytest.raises(ConnectionLostError, match=r"0\.3 s"):
        connection.call("ping")
    connection, _ = connect({"timeout_s": 20, "stopped": stopped}, ping=lambda: hold.wait(20))
    stopped.set()
    with pytest.raises(StoppedError):
        connection.call("ping")
    hold.set()


def test_the_argument_that_only_classic_airsim_wants_is_found_out_once(connect):
    def classic(*params):
        if len(params) != 3:
            raise ValueError("'simGetCameraInfo' was called with an invalid number of arguments. Expected: 3, got: 2")
        return {"pose": pose(), "fov": 60.0}

    connection, server = connect(simGetCameraInfo=classic)
    for _ in range(2):
        assert get_camera(connection, "0", "")[1] == pytest.approx(np.pi / 3)
    assert [params for _, params in server.calls] == [["0", ""], ["0", "", False], ["0", "", False]]


def test_picture_and_depth_are_asked_for_in_one_call(connect):
    connection, server = connect()
    scene, depth = get_images(connection, "front", "Drone1")
    assert (scene["image_type"], depth["image_type"]) == (0, 1)
    ((method, (requests, vehicle)),) = server.calls
    assert (method, vehicle) == ("simGetImages", "Drone1")
    asked = [(one["camera_name"], one["image_type"], one["pixels_as_float"], one["compress"]) for one in requests]
    assert asked == [("front", 0, False, False), ("front", 1, True, False)]


def test_other_answers_than_two_images_and_cameras_without_a_field_of_view_are_refused(connect):
    answers = iter([[], [{}], "x", [1, 2], None])
    fovs = iter([None, 0.0, 180.0, float("nan"), "90"])
    connection, _ = connect(
        simGetImages=lambda *params: next(answers), simGetCameraInfo=lambda *params: {"pose": pose(), "fov": next(fovs)}
    )
    for _ in range(5):
        with pytest.raises(ValueError, match="simGetImages"):
            get_images(connection, "0", "")
        with pytest.raises(ValueError, match=r"'0'.*0 and 180"):
            get_camera(connection, "0", "")
