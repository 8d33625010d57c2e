"""Flight commands, sensors, objects and detections through the published client."""

import math
import threading
import time

import numpy as np
import pytest
from airsim_serving import CONFIG, HEIGHT, WIDTH, ask, connect, open_client, run_server
from scipy.spatial.transform import Rotation

from deckline.adapters.airsim.protocol import encode_request
from deckline_sim.airsim_server.objects import PALETTE
from deckline_sim.simulate import ShipSimulator

airsim = pytest.importorskip("cosysairsim")
RAMP_M, COURSE_RAD = [7.5, 27.1, 6.08], math.radians(170.93)  # of the paper's ship, as in the landing example


@pytest.fixture(scope="module")
def hasty(tmp_path_factory):
    with run_server(tmp_path_factory.mktemp("recordings"), speed=20.0) as running:
        yield running


@pytest.fixture
def pilot(hasty):
    """A client that may fly, on a server in a hurry."""
    with open_client(hasty.port) as made:
        made.reset()
        made.simPause(False)
        made.enableApiControl(True)
        assert made.armDisarm(True) is True
        yield made


def put(client, x, y, z, yaw=0.0):
    pose = airsim.Pose(airsim.Vector3r(x, y, z), airsim.Quaternionr(0, 0, math.sin(yaw / 2), math.cos(yaw / 2)))
    client.simSetVehiclePose(pose, True)


def place(client):
    return np.array(list(client.simGetVehiclePose().position))


def deck_point(client, name="Touchdown"):
    return np.array(list(client.simGetObjectPose(name).position))


def test_takes_off_moves_hovers_turns_and_lands(pilot):
    point = deck_point(pilot)
    put(pilot, *(point - [0.0, 0.0, 0.3]))
    assert pilot.getMultirotorState().landed_state == airsim.LandedState.Landed
    assert pilot.takeoffAsync().get() is True
    assert pilot.getMultirotorState().landed_state == airsim.LandedState.Flying
    goal = point - [-20.0, -10.0, 12.0]
    assert pilot.moveToPositionAsync(*goal.tolist(), 8).get() is True
    np.testing.assert_allclose(place(pilot), goal, atol=0.3)
    assert pilot.hoverAsync().get() is True
    assert pilot.rotateToYawAsync(90, margin=1).get() is True
    turn = pilot.simGetVehiclePose().orientation
    assert 2 * math.atan2(turn.z_val, turn.w_val) == pytest.approx(math.pi / 2, abs=0.03)
    path = [airsim.Vector3r(*corner) for corner in ((goal - [0, -10, 0]).tolist(), (point - [0, 0, 6]).tolist())]
    assert pilot.moveOnPathAsync(path, 6, 60, airsim.DrivetrainType.ForwardOnly, airsim.YawMode(False, 0)).get() is True
    pilot.simGetCollisionInfo()
    assert pilot.landAsync().get() is True
    hit = pilot.simGetCollisionInfo()
    assert hit.has_collided and hit.object_name == "Deck" and not pilot.simGetCollisionInfo().has_collided
    np.testing.assert_allclose(place(pilot), point - [0.0, 0.0, 0.3], atol=0.35)


def test_home_is_where_the_vehicle_started(pilot):
    start, home = place(pilot), pilot.getHomeGeoPoint()
    assert np.linalg.norm(start) > 50.0  # not the world's origin
    assert vars(home) == pytest.approx(vars(pilot.getMultirotorState().gps_location))
    put(pilot, *np.add(start, [20.0, -10.0, -5.0]))
    assert vars(pilot.getHomeGeoPoint()) == vars(home)
    assert pilot.goHomeAsync().get() is True
    np.testing.assert_allclose(place(pilot), start, atol=0.25)


def test_velocities_are_in_the_world_or_the_body(pilot):
    for call, moved in (
        (lambda: pilot.moveByVelocityAsync(3, 0, -1, 4), [12, 0, -4]),
        (lambda: pilot.moveByVelocityZAsync(0, 3, -52, 4), [0, 12, -2]),
        (lambda: pilot.moveByVelocityBodyFrameAsync(3, 0, 0, 4), [0, 12, 0]),
        (lambda: pilot.moveByVelocityZBodyFrameAsync(0, 3, -50, 4), [-12, 0, 0]),
    ):
        put(pilot, 300.0, 0.0, -50.0, yaw=math.pi / 2)
        assert call().get() is True
        np.testing.assert_allclose(place(pilot) - [300.0, 0.0, -50.0], moved, atol=4.5)
    start = place(pilot)
    assert pilot.moveToZAsync(-60, 4).get() is True and abs(place(pilot)[2] + 60) < 0.3
    assert pilot.moveToZAsync(-90, 1, timeout_sec=2).get() is False
    assert pilot.rotateByYawRateAsync(30, 1).get() is True
    assert np.linalg.norm(place(pilot)[:2] - start[:2]) < 4.0


def test_an_attitude_leans_and_accelerates_at_its_height(pilot):
    put(pilot, 500.0, 0.0, -50.0)
    pilot.simPause(True)
    roll, pitch, seconds = math.radians(10.0), math.radians(8.0), 4.0  # to the right, and nose down
    lean = pilot.moveByRollPitchYawZAsync(roll, pitch, 0.0, -48.0, 30.0)
    pilot.ping()
    pilot.simContinueForTime(seconds)
    state = pilot.getMultirotorState().kinematics_estimated
    turn = Rotation.from_quat(list(state.orientation))
    np.testing.assert_allclose(turn.as_euler("ZYX"), [0.0, -pitch, roll], atol=1e-3)
    across = 9.80665 * seconds * np.array([math.tan(pitch), math.tan(roll) / math.cos(pitch)])
    np.testing.assert_allclose([state.linear_velocity.x_val, state.linear_velocity.y_val], across, rtol=0.05)  # drag
    assert state.position.z_val == pytest.approx(-48.0, abs=0.05)
    pilot.simPause(False)
    pilot.cancelLastTask()
    assert lean.get() is False
    with pytest.raises(Exception, match=r"40\.0 deg.*25"):
        pilot.moveByRollPitchYawrateZAsync(math.radians(40.0), 0.0, 0.0, -50.0, 1.0).get()


def test_other_calls_are_answered_in_flight_and_a_new_command_cancels(pilot):
    put(pilot, 500.0, 0.0, -50.0)
    far = pilot.moveToPositionAsync(5000, 0, -50, 5)
    for _ in range(20):
        assert pilot.getMultirotorState().kinematics_estimated.linear_velocity.x_val <= 5.01
    assert not far._set_flag
    near = pilot.moveByVelocityAsync(0, 2, 0, 1)
    assert near.get() is True and far.get() is False
    last = pilot.moveToPositionAsync(5000, 0, -50, 5)
    pilot.ping()
    pilot.cancelLastTask()
    assert last.get() is False


def test_a_paused_vehicle_waits_for_the_time(pilot):
    put(pilot, 500.0, 0.0, -50.0)
    pilot.simPause(True)
    move = pilot.moveByVelocityAsync(4, 0, 0, 2)
    pilot.ping()
    before = place(pilot)
    np.testing.assert_array_equal(place(pilot), before)
    pilot.simContinueForTime(1.0)
    assert pilot.simIsPause() is True and not move._set_flag
    moved = place(pilot)[0] - before[0]
    assert moved == pytest.approx(4 * (1.0 - 0.3), abs=0.6)
    pilot.simContinueForTime(1.5)
    assert move.get() is True
    pilot.simPause(False)


def test_what_may_not_fly_raises_and_join_passes_it_on_to_the_next_call(client):
    with pytest.raises(Exception, match=r"takeoff: .*enableApiControl"):
        client.takeoffAsync().get()
    client.takeoffAsync().join()
    with pytest.raises(Exception, match=r"takeoff: .*enableApiControl"):
        client.getMultirotorState()
    assert client.getMultirotorState() and client.armDisarm(True) is False
    client.enableApiControl(True)
    client.hoverAsync().join()
    with pytest.raises(Exception, match=r"hover: .*armDisarm"):
        client.ping()
    client.moveByMotorPWMsAsync(1, 1, 1, 1, 1).join()
    with pytest.raises(Exception, match="moveByMotorPWMs"):
        client.ping()
    client.armDisarm(True)
    for call, says in (
        (lambda: client.moveToPositionAsync(float("nan"), 0, 0, 5), "path"),
        (lambda: client.moveToPositionAsync(0, 0, 0, -1), "velocity"),
        (lambda: client.moveOnPathAsync([], 5), "1 to 10000"),
        (lambda: client.moveToPositionAsync(0, 0, 0, 5, lookahead=0), "lookahead"),
        (lambda: client.moveByVelocityAsync(1e9, 0, 0, 1), "vx"),
        (lambda: client.moveByVelocityAsync(1, 0, 0, 1, drivetrain=2), "drivetrain.*2"),
        (lambda: client.moveToPositionAsync(0, 0, 0, 5, adaptive_lookahead=0), "adaptive_lookahead.*0"),
        (lambda: client.moveToZAsync(-50, 5, adaptive_lookahead=0.5), r"adaptive_lookahead.*0\.5"),
    ):
        with pytest.raises(Exception, match=says):
            call().get()
        with pytest.raises(Exception, match=says):
            client.ping()


def test_objects_have_names_and_poses(client):
    assert client.simListSceneObjects() == ["Carrier", "Deck", "Ramp", "Touchdown", "Sea", "SimpleFlight"]
    assert client.simListSceneObjects("de.*|ramp") == ["Deck", "Ramp"]
    with pytest.raises(Exception, match=r"'\('"):
        client.simListSceneObjects("(")
    np.testing.assert_allclose(deck_point(client, "Ramp"), RAMP_M, atol=0.1)
    way = deck_point(client) - deck_point(client, "Ramp")
    assert np.linalg.norm(way) == pytest.approx(CONFIG.flight.touchdown_m)
    assert math.atan2(way[1], way[0]) == pytest.approx(COURSE_RAD, abs=1e-3)
    np.testing.assert_allclose(deck_point(client, "SimpleFlight"), place(client))


def test_segmentation_shows_ids_as_set(client):
    def colours():
        (seen,) = client.simGetImages([airsim.ImageRequest("0", airsim.ImageType.Segmentation, False, False)])
        pixels = np.frombuffer(seen.image_data_uint8, np.uint8).reshape(-1, 3)[:, ::-1]
        return {tuple(colour) for colour in np.unique(pixels, axis=0).tolist()}

    put(client, *(deck_point(client, "Ramp") - [-150.0, 25.0, 40.0]), yaw=COURSE_RAD)
    assert tuple(PALETTE[2].tolist()) in colours() and client.simGetSegmentationObjectID("Deck") == 2
    assert client.simSetSegmentationObjectID("Deck", 42) is True
    assert client.simGetSegmentationObjectID("Deck") == 42
    assert tuple(PALETTE[42].tolist()) in colours()
    np.testing.assert_array_equal(PALETTE, airsim.MultirotorClient.simGetSegmentationColorMap()[:256])
    assert client.simSetSegmentationObjectID("de[a-z]*|sea", -1, True) is True
    assert not {tuple(PALETTE[number].tolist()) for number in (1, 42)} & colours()
    assert client.simSetSegmentationObjectID("Cube", 3) is False and client.simGetSegmentationObjectID("Cube") == -1
    with pytest.raises(Exception, match=r"-1 and 255.*300"):
        client.simSetSegmentationObjectID("Deck", 300)


def test_the_deck_is_detected_where_it_is_seen(client):
    put(client, *(deck_point(client, "Ramp") - [-150.0, 25.0, 40.0]), yaw=COURSE_RAD)
    scene = airsim.ImageType.Scene
    assert client.simGetDetections("0", scene) == []
    client.simAddDetectionFilterMeshName("0", scene, "de[ck]*")  # no set of letters
    assert client.simGetDetections("0", scene) == []
    client.simAddDetectionFilterMeshName("0", scene, "dE*")
    (deck,) = client.simGetDetections("0", scene)
    assert deck.name == "Deck"
    box = deck.box2D
    assert 0 <= box.min.x_val < WIDTH / 2 < box.max.x_val <= WIDTH and HEIGHT / 2 < box.max.y_val <= HEIGHT
    stern = client.simGetObjectPose("Deck").position - client.simGetVehiclePose().position
    relative = deck.relative_pose.position
    assert relative.get_length() == pytest.approx(stern.get_length(), rel=1e-5)
    assert deck.box3D.min.x_val < 160.0 < deck.box3D.max.x_val
    client.simSetDetectionFilterRadius("0", scene, 100 * 100)
    assert client.simGetDetections("0", scene) == []
    for number in range(14):
        client.simAddDetectionFilterMeshName("0", scene, f"Cube{number}")
    with pytest.raises(Exception, match="16 mesh names"):
        client.simAddDetectionFilterMeshName("0", scene, "Cube14")
    client.simClearDetectionMeshNames("0", scene)


def test_sensors_measure_with_their_errors(client, server):
    put(client, 1000.0, 0.0, -50.0)
    forces, fields, pressures = [], [], []
    for number in range(200):
        server.ticks[0] = 10.0 + number
        imu = client.getImuData()
        forces.append(imu.linear_acceleration.z_val)
        fields.append(list(client.getMagnetometerData().magnetic_field_body))
        pressures.append(client.getBarometerData().pressure)
    again = client.getImuData("imu")
    assert again.time_stamp == imu.time_stamp and vars(again.linear_acceleration) == vars(imu.linear_acceleration)
    assert np.mean(forces) == pytest.approx(-9.80665, abs=0.02)
    assert np.std(forces) == pytest.approx(0.24e-3 * 9.80665 / math.sqrt(0.003), rel=0.2)
    assert np.std(fields, axis=0) == pytest.approx([0.005] * 3, rel=0.2)
    assert np.mean(fields, axis=0) == pytest.approx([0.18, 0.05, 0.53], abs=0.12)  # Seattle: WMM 2020
    assert pressures[0] == pytest.approx(101325 * (1 - 2.25577e-5 * 172) ** 5.25588, abs=30.0)
    gps = client.getGpsData()
    assert gps.gnss.eph == pytest.approx(0.1, abs=1e-3) and gps.gnss.fix_type == 3
    assert gps.gnss.geo_point.altitude == pytest.approx(172.0, abs=0.5)
    air = client.simGetGroundTruthEnvironment()
    assert air.gravity.z_val == pytest.approx(9.80665) and air.geo_point.altitude == pytest.approx(172.0)


def test_the_distance_sensor_sees_the_water_and_the_deck(client, server):
    assert client.getDistanceSensorData().distance > 39.0  # ahead there is nothing
    client.simSetDistanceSensorPose(
        "Distance", airsim.Pose(airsim.Vector3r(0, 0, 0), airsim.Quaternionr(0, -math.sqrt(0.5), 0, math.sqrt(0.5)))
    )
    with ShipSimulator(CONFIG) as simulator:
        simulator.load(0)
        sea_z_m = simulator.ship.layout.sea_z_m
    for position, expected in (([1000.0, 0.0, sea_z_m - 30.0], 30.0), (deck_point(client) - [0, 0, 5.0], 5.0)):
        put(client, *position)
        server.ticks[0] += 1.0
        assert client.getDistanceSensorData().distance == pytest.approx(expected, abs=0.8)


def test_a_client_that_leaves_in_flight_leaves_the_flight(pilot, hasty):
    put(pilot, 500.0, 0.0, -50.0)
    with connect(hasty.port) as peer:
        peer.sendall(encode_request(1, "moveToPosition", (520.0, 0.0, -50.0, 10.0)))
        assert ask(peer, "ping") == (None, True)
    for _ in range(500):
        if abs(place(pilot)[0] - 520.0) < 0.3:
            return
        time.sleep(0.02)
    raise AssertionError("it did not arrive")


def test_a_flood_of_commands_from_a_client_that_never_reads_holds_up_nobody(pilot, hasty):
    with connect(hasty.port) as peer:
        call = encode_request(1, "moveByVelocity", (1.0, 0.0, 0.0, 1e6))
        sender = threading.Thread(target=lambda: peer.sendall(call * 3000))
        sender.start()
        for _ in range(20):
            with connect(hasty.port) as good:
                assert ask(good, "ping") == (None, True)
        sender.join(30.0)
    assert any(pilot.hoverAsync().get() for _ in range(3000))  # until the last of them has come
