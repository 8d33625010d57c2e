import json

import numpy as np
import pytest

from deckline_sim.airsim_server.settings import ORIGIN, PLANAR, SCENE, CaptureSetting, parse_settings, read_settings

USUAL = CaptureSetting(1280, 720, 90.0)
# As AirSim's documentation has it.
GIVEN = {
    "SettingsVersion": 1.2,
    "SimMode": "Multirotor",
    "ClockSpeed": 5,
    "ViewMode": "Fpv",
    "CameraDefaults": {"CaptureSettings": [{"ImageType": 1, "Width": 256, "Height": 144}]},
    "Vehicles": {
        "Drone1": {
            "VehicleType": "SimpleFlight",
            "X": 4,
            "Yaw": 90,
            "AutoCreate": True,
            "Sensors": {
                "Imu": {"SensorType": 2, "Enabled": True},
                "Radar": {"SensorType": 5, "MaxDistance": 120, "Pitch": -90},
            },
            "Cameras": {
                "nose": {
                    "CaptureSettings": [{"ImageType": 0, "Width": 640, "Height": 480, "FOV_Degrees": 60}],
                    "X": 0.5,
                    "Z": 0.1,
                    "Pitch": -10,
                },
                "1": {"Yaw": 30},
            },
        }
    },
    "Recording": {"RecordInterval": 0.5, "RecordOnMove": True, "Cameras": [{"CameraName": "nose", "ImageType": 0}]},
    "OriginGeopoint": {"Latitude": 30, "Longitude": 120, "Altitude": 5},
}


def test_cameras_have_airsims_names_and_numbers():
    settings = parse_settings({}, USUAL)
    assert (settings.vehicle, settings.origin, settings.interval_s) == ("SimpleFlight", ORIGIN, 0.05)
    names = ["front_center", "front_right", "front_left", "bottom_center", "back_center"]
    assert [settings.find_camera(str(number)) for number in range(5)] == names == list(settings.cameras)
    ahead = {name: setting.mount.rotation.apply([1.0, 0.0, 0.0]) for name, setting in settings.cameras.items()}
    np.testing.assert_allclose(ahead["bottom_center"], [0, 0, 1], atol=1e-12)
    np.testing.assert_allclose(ahead["back_center"], [-1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(ahead["front_left"], [1, 0, 0], atol=1e-12)
    assert (
        settings.cameras["front_left"].mount.translation[1] < 0 < settings.cameras["front_right"].mount.translation[1]
    )
    with pytest.raises(ValueError, match=r"'x'.*front_center"):
        settings.find_camera("x")


def test_what_a_camera_that_looks_down_is_not_given_stays():
    given = {"Vehicles": {"D": {"Cameras": {"3": {"X": 1}}}}}
    mount = parse_settings(given, USUAL).cameras["bottom_center"].mount
    np.testing.assert_allclose(mount.translation, [1, 0, 0])
    np.testing.assert_allclose(mount.rotation.apply([1, 0, 0]), [0, 0, 1], atol=1e-12)


def test_a_settings_file_is_read_as_airsim_does(tmp_path):
    file = tmp_path / "settings.json"
    file.write_text(json.dumps(GIVEN))
    settings = read_settings(file, USUAL)
    assert settings.vehicle == "Drone1" and settings.origin == (30.0, 120.0, 5.0)
    assert (settings.interval_s, settings.on_move, settings.recorded) == (0.5, True, "nose")
    assert settings.unused == ("ViewMode", "Vehicles.Drone1.AutoCreate")
    assert settings.clock_speed == 5.0
    np.testing.assert_allclose(settings.start.translation, [4.0, 0.0, 0.0])
    np.testing.assert_allclose(settings.start.rotation.apply([1.0, 0.0, 0.0]), [0.0, 1.0, 0.0], atol=1e-12)
    settings.check_sensor("imu", "Imu")
    settings.check_sensor("imu", "")
    with pytest.raises(ValueError, match=r"no gps 'Imu'; there are gps$"):
        settings.check_sensor("gps", "Imu")
    assert settings.find_distance("") == "Radar" and settings.distances["Radar"].farthest_m == 120.0
    np.testing.assert_allclose(settings.distances["Radar"].mount.rotation.apply([1.0, 0.0, 0.0]), [0, 0, 1], atol=1e-12)
    with pytest.raises(ValueError, match=r"'x'.*Radar"):
        settings.find_distance("x")
    assert json.loads(settings.text) == GIVEN
    nose = settings.cameras["nose"]
    assert nose.capture(SCENE) == CaptureSetting(640, 480, 60.0)
    assert nose.capture(PLANAR) == CaptureSetting(256, 144, 90.0)
    assert nose.capture(5) == USUAL
    np.testing.assert_allclose(nose.mount.translation, [0.5, 0.0, 0.1])
    down = np.sin(np.deg2rad(10.0))
    np.testing.assert_allclose(nose.mount.rotation.apply([1.0, 0.0, 0.0]), [np.sqrt(1 - down**2), 0.0, down])
    turned = settings.cameras["front_right"].mount
    np.testing.assert_allclose(turned.rotation.apply([1.0, 0.0, 0.0]), [np.sqrt(0.75), 0.5, 0.0], atol=1e-12)
    np.testing.assert_allclose(turned.translation, parse_settings({}, USUAL).cameras["front_right"].mount.translation)
    assert "1" not in settings.cameras


UNUSED = [
    ({"Wind": {"X": 5}}, ["Wind"]),
    ({"SimMode": "Car"}, ["SimMode 'Car'"]),
    ({"OriginGeopoint": {"Latitude": 1, "Height": 2}}, ["OriginGeopoint.Height"]),
    ({"CameraDefaults": {"X": 1, "CaptureSettings": []}}, ["CameraDefaults.X"]),
    ({"CameraDefaults": {"CaptureSettings": [{"TargetGamma": 1}]}}, ["CameraDefaults.CaptureSettings.TargetGamma"]),
    ({"Recording": {"Enabled": True, "Folder": "/"}}, ["Recording.Enabled", "Recording.Folder"]),
    ({"Recording": {"Enabled": False, "Cameras": [{"CameraName": "0", "ImageType": 1}]}}, []),
    ({"Recording": {"Cameras": [{"ImageType": 5}, {"CameraName": "3"}]}}, ["Recording.Cameras '3'", "ImageType '5'"]),
    ({"Vehicles": {"A": {"VehicleType": "simpleflight"}}}, []),
    ({"Vehicles": {"A": {"VehicleType": "PX4Multirotor"}}}, ["Vehicles.A.VehicleType 'PX4Multirotor'"]),
    ({"Vehicles": {"A": {"Cameras": {"c": {"Gimbal": {}, "X": 1}}}}}, ["Vehicles.A.Cameras.c.Gimbal"]),
    ({"Vehicles": {"A": {"Sensors": {"L": {"SensorType": 6}}}}}, ["Vehicles.A.Sensors.L"]),
    ({"Vehicles": {"A": {"Sensors": {"L": {"SensorType": []}}}}}, ["Vehicles.A.Sensors.L"]),
    ({"Vehicles": {"A": {"Sensors": {"G": {"SensorType": 3, "Enabled": False}}}}}, ["Vehicles.A.Sensors.G.Enabled"]),
    (
        {"Vehicles": {"A": {"Sensors": {"D": {"SensorType": 5, "Enabled": True, "Yaw": 1, "DrawDebugPoints": True}}}}},
        ["Vehicles.A.Sensors.D.DrawDebugPoints"],
    ),
]


@pytest.mark.parametrize(("values", "names"), UNUSED)
def test_what_settings_ask_for_in_vain_is_named(values, names):
    unused = parse_settings(values, USUAL).unused
    assert len(unused) == len(names) and all(name.endswith(own) for name, own in zip(unused, names, strict=True))


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ('{"Vehicles": {"A": {}, "B": {}}}', "Vehicles.*A, B"),
        ('{"Vehicles": []}', "Vehicles.*list"),
        ('{"CameraDefaults": {"CaptureSettings": [{"Width": 9999}]}}', "Width.*1 and 4096.*9999"),
        ('{"CameraDefaults": {"CaptureSettings": {}}}', "CaptureSettings.*dict"),
        ('{"CameraDefaults": {"CaptureSettings": [{"FOV_Degrees": "90"}]}}', "FOV_Degrees.*'90'"),
        ('{"Recording": {"RecordInterval": 0}}', r"RecordInterval.*0\.01"),
        ('{"Recording": {"RecordOnMove": 1}}', "RecordOnMove.*1"),
        ('{"Recording": {"Cameras": [{"CameraName": "tail"}]}}', "'tail'"),
        ('{"OriginGeopoint": {"Latitude": 95}}', "Latitude.*-89 and 89.*95"),
        ('{"Vehicles": {"A": {"Cameras": {"c": {"Roll": null}}}}}', r"Cameras\.c\.Roll.*None"),
        ("{", r"settings\.json"),
    ],
)
def test_what_cannot_be_is_named(text, says, tmp_path):
    file = tmp_path / "settings.json"
    file.write_text(text)
    with pytest.raises(ValueError, match=says):
        read_settings(file, USUAL)
