import threading
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from airsim_serving import CONFIG, EPOCH_NS, HEIGHT, WIDTH, asked, connected, ended, published_client, running_server
from hypothesis import given
from hypothesis import strategies as st

from deckline.adapters.airsim import server as airsim_server
from deckline.adapters.airsim.clock import Clock
from deckline.adapters.airsim.protocol import encode_request
from deckline.recording import open_recording
from deckline.recording.images import read_image
from deckline.sim import frames
from deckline.sim.simulate import Simulator

airsim = pytest.importorskip("cosysairsim")
SCENE, PLANAR, PERSPECTIVE = airsim.ImageType.Scene, airsim.ImageType.DepthPlanar, airsim.ImageType.DepthPerspective
FAR_M = 65504.0
TURNED = airsim.Quaternionr(0.1, 0.5, 0.1, 0.7300000000000000**0.5)  # of length 1


def bytes_of(response):
    return np.frombuffer(response.image_data_uint8, np.uint8).reshape(response.height, response.width, 3)


def floats_of(response):
    return np.array(response.image_data_float, np.float32).reshape(response.height, response.width)


def raw(kind=SCENE, camera="0"):
    return airsim.ImageRequest(camera, kind, pixels_as_float=False, compress=False)


def pose_of(transform):
    x, y, z, w = transform.rotation.as_quat().tolist()
    return airsim.Pose(airsim.Vector3r(*transform.translation.tolist()), airsim.Quaternionr(x, y, z, w))


@pytest.fixture(scope="module")
def flight():
    """The recording that `deckline sim` makes with the same options; its first frame is where the vehicle starts."""
    return list(frames(replace(CONFIG, frames=3, end_m=60.0)))


def test_the_published_client_connects(client, server, capsys):
    client.confirmConnection()
    said = capsys.readouterr()
    assert "Connected!" in said.out and "Server Ver:4" in said.out and not said.err
    client.enableApiControl(True)
    assert client.isApiControlEnabled() is True
    assert client.armDisarm(True) is True
    assert client.listVehicles() == ["SimpleFlight"]
    assert client.getSettingsString() == "{}"
    assert not server.lines


def test_pictures_are_those_of_a_recording(client, server, flight, tmp_path):
    requests = [raw(), airsim.ImageRequest("0", SCENE), airsim.ImageRequest("0", PLANAR, True)]
    requests += [airsim.ImageRequest("0", PERSPECTIVE, True), raw(airsim.ImageType.Segmentation)]
    for frame in flight:
        server.ticks[0] = frame.time_s
        client.simSetVehiclePose(pose_of(frame.world_from_body), True)
        scene, packed, planar, perspective, labels = client.simGetImages(requests)
        assert (scene.width, scene.height, scene.image_type) == (WIDTH, HEIGHT, SCENE)
        differ = np.abs(bytes_of(scene)[:, :, ::-1].astype(int) - frame.image_rgb).max(axis=2)
        assert differ.max() <= 1 and (differ > 0).mean() < 0.01  # the pose's last bits went through a quaternion
        (tmp_path / "a.png").write_bytes(packed.image_data_uint8)
        np.testing.assert_array_equal(read_image(tmp_path / "a.png"), bytes_of(scene)[:, :, ::-1])
        expected = np.nan_to_num(frame.depth_m, nan=FAR_M)
        near = expected < 2000.0
        np.testing.assert_allclose(floats_of(planar)[near], expected[near], rtol=1e-4)
        u, v = np.meshgrid(np.arange(WIDTH) - (WIDTH - 1) / 2, np.arange(HEIGHT) - (HEIGHT - 1) / 2)
        rays = np.sqrt(1 + (u**2 + v**2) / (WIDTH / 2) ** 2)  # 90 degrees: the focal length is half the width
        seen = floats_of(planar) < FAR_M
        np.testing.assert_allclose(
            floats_of(perspective)[seen], np.minimum(floats_of(planar) * rays, FAR_M)[seen], 1e-5
        )
        assert np.all(floats_of(perspective)[~seen] == np.float32(FAR_M))
        np.testing.assert_array_equal(~bytes_of(labels).any(axis=2), np.isnan(frame.depth_m))
        assert scene.time_stamp == planar.time_stamp == EPOCH_NS + round(frame.time_s * 1e9)


def test_poses_are_kept_where_they_are_nan(client):
    client.simSetVehiclePose(airsim.Pose(airsim.Vector3r(1, 2, -30), TURNED), True)
    before = client.simGetVehiclePose()
    np.testing.assert_allclose(list(before.position), [1, 2, -30])
    np.testing.assert_allclose(list(before.orientation), list(TURNED), atol=1e-12)
    client.simSetVehiclePose(airsim.Pose(airsim.Vector3r(4, 5, -60), airsim.Quaternionr.nanQuaternionr()), True)
    moved = client.simGetVehiclePose()
    np.testing.assert_allclose(list(moved.position), [4, 5, -60])
    np.testing.assert_allclose(list(moved.orientation), list(before.orientation), atol=1e-12)
    client.simSetVehiclePose(airsim.Pose(airsim.Vector3r.nanVector3r(), airsim.Quaternionr()), True)
    state = client.getMultirotorState()
    np.testing.assert_allclose(list(state.kinematics_estimated.position), [4, 5, -60])
    np.testing.assert_allclose(list(client.simGetGroundTruthKinematics().orientation), [0, 0, 0, 1], atol=1e-12)
    assert state.landed_state == airsim.LandedState.Flying and state.timestamp == EPOCH_NS


def test_cameras_look_where_they_are_mounted(client):
    height_m = 40.0
    with Simulator(CONFIG) as simulator:
        simulator.load(0)
        sea_z_m = simulator.ship.layout.sea_z_m
    client.simSetVehiclePose(airsim.Pose(airsim.Vector3r(3000.0, 0.0, sea_z_m - height_m), airsim.Quaternionr()), True)
    left, right, down = client.simGetImages(
        [airsim.ImageRequest(camera, PLANAR, True) for camera in ("front_left", "1", "bottom_center")]
    )
    np.testing.assert_allclose(list(right.camera_position - left.camera_position), [0.0, 0.25, 0.0], atol=1e-9)
    np.testing.assert_allclose(floats_of(down), height_m, rtol=1e-4)
    client.simSetCameraPose(
        "bottom_center", airsim.Pose(airsim.Vector3r(0, 0, 10.0), airsim.Quaternionr().nanQuaternionr())
    )
    (lower,) = client.simGetImages([airsim.ImageRequest("bottom_center", PLANAR, True)])
    np.testing.assert_allclose(floats_of(lower), height_m - 10.0, rtol=1e-4)
    client.simSetCameraFov("front_center", 53.13010235415598)
    info = client.simGetCameraInfo("0")
    assert info.fov == pytest.approx(53.13010235415598)
    assert info.proj_mat.matrix[0][1] == pytest.approx(2.0)  # 1 / tan(fov / 2)
    np.testing.assert_allclose(list(info.pose.position), [3000.0, 0.0, sea_z_m - height_m])


def test_fog_and_night_are_those_of_the_simulator(client):
    foggy = next(frames(replace(CONFIG, visibility_m=(500.0, 500.0))))
    client.simSetWeatherParameter(airsim.WeatherParameter.Fog, 0.1)
    (clear,) = client.simGetImages([raw()])
    client.simEnableWeather(True)
    (fog,) = client.simGetImages([raw()])
    np.testing.assert_array_equal(bytes_of(fog)[:, :, ::-1], foggy.image_rgb)
    assert np.abs(bytes_of(clear).astype(int) - bytes_of(fog)).mean() > 10
    client.simEnableWeather(False)
    client.simSetTimeOfDay(True, "2026-06-21 00:00:00")
    (night,) = client.simGetImages([raw()])
    assert bytes_of(night).mean() < 0.75 * bytes_of(clear).mean()
    client.simSetTimeOfDay(False)
    (day,) = client.simGetImages([raw()])
    np.testing.assert_array_equal(bytes_of(day), bytes_of(clear))


def test_recordings_are_read_by_deckline(client, server):
    assert client.isRecording() is False
    client.startRecording()
    for z in (-60.0, -50.0):
        client.simSetVehiclePose(airsim.Pose(airsim.Vector3r(300.0, 0.0, z), airsim.Quaternionr(0, 0, 1, 0)), True)
        time.sleep(0.3)
    assert client.isRecording() is True
    client.stopRecording()
    assert client.isRecording() is False
    (folder,) = server.out.iterdir()
    rows = (folder / "airsim_rec.txt").read_text().splitlines()
    assert rows[0].split("\t")[:2] == ["VehicleName", "TimeStamp"] and rows[1].startswith("SimpleFlight\t")
    source = open_recording(folder)
    loaded = [source.load(index) for index in range(len(source))]
    assert {frame.world_from_body.translation[2] for frame in loaded} >= {-60.0, -50.0}
    assert all(frame.image_rgb.shape == (HEIGHT, WIDTH, 3) and frame.depth_m is not None for frame in loaded)
    assert loaded[0].truth.left is not None and loaded[0].deck_z_m is not None
    assert any("recorded" in line for line in server.lines)


def test_the_ship_is_an_object(client, flight):
    carrier = client.simGetObjectPose("Carrier")
    where = flight[0].truth.world_from_ship
    np.testing.assert_allclose(list(carrier.position), where.translation)
    assert client.simGetObjectPose("Cube").containsNan()


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda c: c.client.call("moveToMoon", 1), "no method 'moveToMoon'; there are"),
        (lambda c: c.simGetImage("spare", 0), "no camera 'spare'; there are front_center"),
        (lambda c: c.simGetImage("0", 7), r"no image type 7; there are Scene \(0\)"),
        (lambda c: c.simGetVehiclePose("Drone9"), "no vehicle 'Drone9'; there is 'SimpleFlight'"),
        (lambda c: c.client.call("ping", 1, 2), "ping: 2 parameters"),
        (lambda c: c.client.call("simSetVehiclePose", {}, True), "a pose needs position with x_val"),
        (lambda c: c.simSetWeatherParameter(7, 2.0), "must lie between 0 and 1, got 2"),
        (lambda c: c.simSetTimeOfDay(True, "noon"), "written like 2026-02-12"),
        (lambda c: c.simSetVehiclePose(airsim.Pose(airsim.Vector3r(1e9, 0, 0)), True), "farther than 1e"),
    ],
)
def test_wrong_calls_get_an_error_and_the_next_one_an_answer(client, call, says):
    with pytest.raises(Exception, match=says):
        call(client)
    assert client.ping() is True


def test_a_camera_under_water_is_an_error_for_its_own_client_only(client, server):
    client.simSetVehiclePose(airsim.Pose(airsim.Vector3r(0, 0, 500.0)), True)
    with pytest.raises(Exception, match="above the sea"):
        client.simGetImages([raw()])
    client.reset()
    assert len(client.simGetImages([raw()])) == 1
    with pytest.raises(Exception, match="no method"):
        client.client.call("simDance")
    assert any("no method 'simDance'" in line for line in server.lines)


def test_classic_clients_give_three_parameters(client, server):
    request = {"camera_name": "0", "image_type": 0, "pixels_as_float": False, "compress": False}
    with connected(server.port) as peer:
        error, (response,) = asked(peer, "simGetImages", [request], "", False)
    assert error is None
    np.testing.assert_array_equal(
        np.frombuffer(response["image_data_uint8"], np.uint8), bytes_of(client.simGetImages([raw()])[0]).ravel()
    )


def test_sixteen_clients_at_once_see_the_same(client, server):
    expected = client.simGetImages([raw()])[0].image_data_uint8
    seen = []

    def look():
        with published_client(server.port) as other:
            seen.extend(other.simGetImages([raw()])[0].image_data_uint8 for _ in range(2))

    threads = [threading.Thread(target=look) for _ in range(16)]
    for thread in threads:
        thread.start()
    assert client.ping() is True
    for thread in threads:
        thread.join()
    assert len(seen) == 32 and set(seen) == {expected}


def test_more_connections_than_there_may_be_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(airsim_server, "MOST_CONNECTIONS", 2)
    with running_server(tmp_path) as few, connected(few.port) as first, connected(few.port) as second:
        assert asked(first, "ping") == asked(second, "ping") == (None, True)
        with connected(few.port) as third:
            assert ended(third)
        assert asked(first, "ping") == (None, True)
        assert few.lines[0].endswith("refused, 2 connections are open")
        second.close()
        for _ in range(100):
            try:
                with connected(few.port) as again:
                    assert asked(again, "ping") == (None, True)
                    break
            except ConnectionError:
                time.sleep(0.01)
        else:
            raise AssertionError("no place was given back")


def test_many_requests_keep_memory_flat(server):
    requests = [{"camera_name": "0", "image_type": kind, "pixels_as_float": kind == 1} for kind in (0, 1, 5)]

    def resident_mib():
        with Path("/proc/self/statm").open() as file:
            return int(file.read().split()[1]) * 4096 / 2**20

    with connected(server.port) as peer:
        for _ in range(20):
            asked(peer, "simGetImages", requests, "")
        before = resident_mib()
        for _ in range(100):
            error, answers = asked(peer, "simGetImages", requests, "")
            assert error is None and len(answers) == 3
        assert resident_mib() - before < 8.0  # 100 times the answers are 12 MiB, the frames behind them 60


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (b"GET / HTTP/1.1\r\n\r\n", "no msgpack-rpc message: 71"),
        (b"\xc6\x7f\xff\xff\xff", "bytes or more"),
        (b"\x94\x01\x07\xc0\xc3", "an answer, though nothing was asked"),
        (encode_request(1, "ping", ())[:-1], "left in the middle of a message"),
    ],
)
def test_broken_connections_are_named_and_closed(client, server, data, says):
    with connected(server.port) as peer:
        peer.sendall(data)
        peer.shutdown(1)
        assert ended(peer)
    assert client.ping() is True
    assert len(server.lines) == 1 and server.lines[0].startswith("127.0.0.1:") and says in server.lines[0]


def test_what_is_too_large_is_refused_as_it_comes(tmp_path, server):
    with running_server(tmp_path, message_limit=100_000) as small, connected(small.port) as peer:
        with pytest.raises(OSError):
            for _ in range(400):
                peer.sendall(encode_request(1, "ping", ())[:2] + b"\xc5\xff\xff" + b"x" * 65535)
                time.sleep(0.001)
        with connected(small.port) as other:
            assert asked(other, "ping") == (None, True)
        assert "closed" in small.lines[0]


def test_all_connections_together_hold_so_much(tmp_path, monkeypatch):
    monkeypatch.setattr(airsim_server, "MOST_HELD", 150_000)
    half = b"\x94\x00\x07\xa1m\x91\xc6\x00\x02\x00\x00" + b"x" * 90_000  # 128 KiB are announced
    with running_server(tmp_path) as tight, connected(tight.port) as first, connected(tight.port) as second:
        first.sendall(half)
        time.sleep(0.1)
        second.sendall(half)
        assert ended(second)
        assert "all connections together hold too much" in tight.lines[0]
        first.sendall(b"x" * (131_072 - 90_000))
        assert first.recv(100).startswith(b"\x94\x01\x07")


def test_a_peer_that_takes_no_answer_is_given_up(tmp_path, monkeypatch):
    monkeypatch.setattr(airsim_server, "PATIENCE_S", 0.2)
    images = [{"camera_name": "0", "image_type": PLANAR, "pixels_as_float": True}] * 64
    with running_server(tmp_path) as server, connected(server.port) as peer, connected(server.port) as other:
        peer.sendall(encode_request(1, "simGetImages", (images, "")) * 12)  # 20 MB of answers
        for _ in range(500):
            if server.lines:
                break
            assert asked(other, "ping") == (None, True)
            time.sleep(0.01)
        assert "took no answer for 0.2 s" in server.lines[0]


def test_half_open_connections_hold_up_nobody(client, server):
    peers = [connected(server.port) for _ in range(20)]
    for peer in peers:
        peer.sendall(encode_request(1, "simGetImages", (["x" * 100],))[:-50])
    assert client.ping() is True
    assert len(client.simGetImages([raw()])) == 1
    for peer in peers:
        peer.close()


@given(st.lists(st.tuples(st.sampled_from(["on", "off", "tick", "for"]), st.floats(0.0, 50.0)), max_size=12))
def test_the_clock_runs_only_when_it_may(steps):
    tick, clock_ticks, expected, left = 0.0, [0.0], 0.0, np.inf
    clock = Clock(lambda: clock_ticks[0], epoch_ns=5)
    for kind, value in steps:
        if kind == "tick":
            tick += value
            clock_ticks[0] = tick
            ran = min(value, left)
            expected, left = expected + ran, left - ran
        elif kind == "for":
            clock.run_for(value)
            left = value
        else:
            clock.pause(kind == "off")
            left = 0.0 if kind == "off" else np.inf
        assert clock.seconds() == pytest.approx(expected, abs=1e-9)
    assert clock.nanoseconds(2.5) == 2_500_000_005
