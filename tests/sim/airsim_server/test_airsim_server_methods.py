from dataclasses import replace

import numpy as np
import pytest
from airsim_serving import CONFIG, EPOCH_NS, HEIGHT, WIDTH, ask, connect

from deckline.recording.images import read_image
from deckline_sim import frames
from deckline_sim.simulate import ShipSimulator

airsim = pytest.importorskip("cosysairsim")
SCENE, PLANAR, PERSPECTIVE = (
    airsim.ImageType.Scene,
    airsim.ImageType.DepthPlanar,
    airsim.ImageType.DepthPerspective,
)
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


def test_poses_are_kept_where_they_are_nan_and_the_ship_is_an_object(client, flight):
    carrier = client.simGetObjectPose("Carrier")
    np.testing.assert_allclose(list(carrier.position), flight[0].truth.world_from_ship.translation)
    assert client.simGetObjectPose("Cube").containsNan()
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
    with ShipSimulator(CONFIG) as simulator:
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


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda c: c.client.call("moveToMoon", 1), "moveToMoon"),
        (lambda c: c.simGetImage("spare", 0), "'spare'.*front_center"),
        (lambda c: c.simGetImage("0", 7), r"7.*Scene \(0\)"),
        (lambda c: c.simGetVehiclePose("Drone9"), "'Drone9'.*'SimpleFlight'"),
        (lambda c: c.client.call("ping", 1, 2), "ping: 2"),
        (lambda c: c.client.call("simSetVehiclePose", {}, True), "simSetVehiclePose: pose: position.*x_val.*None"),
        (lambda c: c.simSetWeatherParameter(7, 2.0), "weather intensity.*0 and 1.*2"),
        (lambda c: c.simSetWeatherParameter(airsim.WeatherParameter.Snow, 0.5), r"Snow \(2\).*Fog"),
        (lambda c: c.simSetWeatherParameter(airsim.WeatherParameter.Dust, 0.5), r"Dust \(6\)"),
        (lambda c: c.simSetWeatherParameter(9, 0.5), "0 and 8.*9"),
        (lambda c: c.getLidarData(), "getLidarData is not supported"),
        (
            lambda c: c.simSpawnObject("Cube", "Cube", airsim.Pose(), airsim.Vector3r()),
            "simSpawnObject is not supported",
        ),
        (lambda c: c.simSetTimeOfDay(True, "noon"), "noon"),
        (lambda c: c.simSetVehiclePose(airsim.Pose(airsim.Vector3r(1e7, 0, 0)), True), r"position.*1e\+06"),
        (lambda c: c.simSetVehiclePose(airsim.Pose(), False), "ignore_collision False"),
        (lambda c: c.simSetTimeOfDay(True, move_sun=False), "move_sun False.*celestial_clock_speed"),
        (lambda c: c.simGetObjectPose("Deck", ned=False), "ned False"),
        (lambda c: c.client.call("simGetImage", "0", 0, "", "", True), "external True"),
        (lambda c: c.client.call("simGetCameraInfo", "0", "", True), "external True"),
        (lambda c: c.getImuData("Imu2"), "no imu 'Imu2'; there are imu$"),
        (lambda c: c.getBarometerData("gps"), "no barometer 'gps'"),
        (lambda c: c.simSetSegmentationObjectID("Deck", 3, 1), "is_name_regex.*1"),
    ],
)
def test_wrong_calls_get_an_error_and_the_next_one_an_answer(client, call, says):
    with pytest.raises(Exception, match=says):
        call(client)
    assert client.ping() is True


@pytest.mark.parametrize(
    ("call", "name"),
    [
        (lambda c: c.moveByManualAsync(1, 1, -10, 1), "moveByManual"),
        (lambda c: c.moveByRollPitchYawThrottleAsync(0, 0, 0, 1, 1), "moveByRollPitchYawThrottle"),
        (lambda c: c.moveByAngleRatesZAsync(0, 0, 0, -9, 1), "moveByAngleRatesZ"),
    ],
)
def test_refused_flight_commands_name_themselves_at_once_and_after_join(client, call, name):
    with pytest.raises(Exception, match=f"{name} is not supported"):
        call(client).get()
    with pytest.raises(Exception, match=f"{name} is not supported"):
        client.ping()
    assert client.ping() is True


def test_a_camera_under_water_is_an_error_for_its_own_client_only(client, server):
    client.simSetVehiclePose(airsim.Pose(airsim.Vector3r(0, 0, 500.0)), True)
    with pytest.raises(Exception, match=r"500\.00 m"):
        client.simGetImages([raw()])
    client.reset()
    assert len(client.simGetImages([raw()])) == 1
    with pytest.raises(Exception, match="simDance"):
        client.client.call("simDance")
    assert any("simDance" in line for line in server.lines)


def test_classic_clients_give_three_parameters(client, server):
    request = {"camera_name": "0", "image_type": 0, "pixels_as_float": False, "compress": False}
    with connect(server.port) as peer:
        error, (response,) = ask(peer, "simGetImages", [request], "", False)
    assert error is None
    np.testing.assert_array_equal(
        np.frombuffer(response["image_data_uint8"], np.uint8), bytes_of(client.simGetImages([raw()])[0]).ravel()
    )
