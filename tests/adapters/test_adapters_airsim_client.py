import socket
import threading
from contextlib import ExitStack

import msgpack
import numpy as np
import pytest
from airsim_stand_in import HALF, StandIn, pose, quaternion, vector

from deckline.adapters.airsim.client import (
    Connection,
    Lost,
    Refused,
    Stopped,
    camera_info,
    parse_address,
    pose_from,
    take_images,
    vehicle_pose,
)


@pytest.fixture
def connect():
    """Connections that are closed when the test ends."""
    with ExitStack() as stack:
        yield lambda port, **options: stack.enter_context(Connection("127.0.0.1", port, **options))


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
def test_a_wrong_address_is_told_the_right_form(address):
    with pytest.raises(ValueError, match=address.replace("//", "/?/?")):
        parse_address(address)


def test_a_call_goes_out_as_msgpack_rpc_and_its_result_comes_back(connect):
    with StandIn(add=lambda a, b: a + b) as server:
        connection = connect(server.port)
        assert connection.call("add", 2, 3) == 5
        assert connection.call("add", "x", "y") == "xy"
        assert server.calls == [("add", [2, 3]), ("add", ["x", "y"])]


def test_an_answer_in_small_pieces_is_put_together():
    answer = msgpack.packb([1, 1, None, list(range(500))])
    with socket.create_server(("127.0.0.1", 0)) as listening:

        def serve():
            talk, _ = listening.accept()
            with talk:
                talk.recv(65536)
                for at in range(0, len(answer), 7):
                    talk.sendall(answer[at : at + 7])
                talk.recv(1)

        thread = threading.Thread(target=serve)
        thread.start()
        with Connection("127.0.0.1", listening.getsockname()[1]) as connection:
            assert connection.call("anything") == list(range(500))
        thread.join()


def test_an_error_of_the_server_is_a_refusal_with_its_words_in_one_line(connect):
    def refuse(*_params):
        raise ValueError("no such\ncamera")

    with StandIn(simGetCameraInfo=refuse) as server:
        connection = connect(server.port)
        with pytest.raises(Refused, match=r"^simGetCameraInfo: no such\\ncamera$"):
            camera_info(connection, "9", "")
        assert vehicle_pose(connection, "").translation.tolist() == [1.0, 2.0, -3.0]  # the line still stands


def test_nobody_there_is_lost_and_says_where():
    with socket.create_server(("127.0.0.1", 0)) as listening:
        port = listening.getsockname()[1]
    with pytest.raises(Lost, match=f"127.0.0.1:{port}: Connection refused"):
        Connection("127.0.0.1", port)


@pytest.mark.parametrize(
    ("came", "text"),
    [
        (b"HTTP/1.1 400 Bad Request\r\n\r\n", "what answers there is no AirSim"),
        (b"\x94\x01\x01\xc0", r"^127\.0\.0\.1:\d+: it hung up$"),  # cut short
        (msgpack.packb([1, 99, None, 0]), "answer 99 came to call 1"),
        (b"\xc1", "what answers there is no AirSim"),
    ],
)
def test_what_is_no_answer_loses_the_connection(came, text, connect):
    with StandIn(ping=lambda: came) as server:
        connection = connect(server.port)
        with pytest.raises(Lost, match=text):
            connection.call("ping")


def test_silence_ends_after_its_time_and_a_stop_ends_it_before(connect):
    hold = threading.Event()
    with StandIn(ping=lambda: hold.wait(20)) as server:
        connection = connect(server.port, timeout_s=0.3)
        with pytest.raises(Lost, match=r"no answer in 0\.3 s"):
            connection.call("ping")
        stopped = threading.Event()
        connection = connect(server.port, stopped=stopped, timeout_s=20)
        stopped.set()
        with pytest.raises(Stopped):
            connection.call("ping")
        hold.set()


def test_the_argument_that_only_classic_airsim_wants_is_found_out_once(connect):
    def classic(*params):
        if len(params) != 3:
            raise ValueError(
                "Function 'simGetCameraInfo' was called with an invalid number of arguments. Expected: 3, got: 2"
            )
        return {"pose": pose(), "fov": 60.0}

    with StandIn(simGetCameraInfo=classic) as server:
        connection = connect(server.port)
        assert camera_info(connection, "0", "")[1] == pytest.approx(np.pi / 3)
        assert camera_info(connection, "0", "")[1] == pytest.approx(np.pi / 3)
        assert [params for _, params in server.calls] == [["0", ""], ["0", "", False], ["0", "", False]]


def test_picture_and_depth_are_asked_for_in_one_call(connect):
    with StandIn() as server:
        connection = connect(server.port)
        scene, depth = take_images(connection, "front", "Drone1")
    assert (scene["image_type"], depth["image_type"]) == (0, 1)
    (call,) = server.calls
    assert call[0] == "simGetImages"
    asked = [(one["camera_name"], one["image_type"], one["pixels_as_float"], one["compress"]) for one in call[1][0]]
    assert asked == [("front", 0, False, False), ("front", 1, True, False)]
    assert call[1][1] == "Drone1"


@pytest.mark.parametrize("answer", [[], [{}], "x", [1, 2], None])
def test_other_answers_than_two_images_are_refused(answer, connect):
    with StandIn(simGetImages=lambda *params: answer) as server:
        connection = connect(server.port)
        with pytest.raises(ValueError, match="two images were asked for"):
            take_images(connection, "0", "")


@pytest.mark.parametrize("fov", [None, 0.0, 180.0, float("nan"), "90"])
def test_a_camera_without_a_field_of_view_is_refused(fov, connect):
    with StandIn(simGetCameraInfo=lambda *params: {"pose": pose(), "fov": fov}) as server:
        connection = connect(server.port)
        with pytest.raises(ValueError, match="no field of view between 0 and 180 deg"):
            camera_info(connection, "0", "")


def test_a_pose_is_read_scalar_first_whatever_the_order_of_its_names():
    at = pose_from({"orientation": quaternion(HALF, 0, 0, HALF), "position": vector(1, 2, -3)}, "camera")
    np.testing.assert_allclose(at.apply([10.0, 0.0, 0.0]), [1.0, 12.0, -3.0], atol=1e-9)  # nose to the east


@pytest.mark.parametrize(
    "value", [None, {}, {"position": vector(0, 0, 0)}, pose((float("nan"), 0, 0)), pose(turn=(0, 0, 0, 0))]
)
def test_what_is_no_pose_is_refused_with_its_owner(value):
    with pytest.raises(ValueError, match=r"^vehicle 'x'"):
        pose_from(value, "vehicle 'x'")
