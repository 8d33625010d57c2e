import sys

import numpy as np
import pytest
from log_bytes import dataflash, telemetry, ulog
from scipy.spatial.transform import Rotation

from deckline.config import Navigation
from deckline.recording import RecordingError
from deckline.recording.geodesy import ecef_from_geodetic, ecef_from_ned
from deckline.recording.logs import read_log_track
from deckline.recording.pose_track import read_csv_track

pytest.importorskip("pymavlink")
pytest.importorskip("pyulog")

ORIGIN = (46.017, 7.750, 1673.0)
TIMES = np.arange(10.0, 14.0, 0.04)  # attitude at 25 Hz
SLOW = np.arange(10.0, 14.0, 0.2)  # position at 5 Hz
ANGLES = np.column_stack([TIMES, 5 * np.sin(TIMES), -3 + 0 * TIMES, 10 * TIMES])
PLACES = np.column_stack([SLOW, 46.017 + 1e-4 * (SLOW - 10), 7.75 + 0 * SLOW, 1673.0 + 2 * (SLOW - 10)])


def write_ulog(path, angles, places):
    quaternions = Rotation.from_euler("ZYX", angles[:, :0:-1], degrees=True).as_quat(scalar_first=True)
    return ulog(path, np.column_stack([angles[:, 0], quaternions]), places)


OWN_CLOCK = Navigation(offset_s=0.0)
WRITERS = {"log.bin": dataflash, "log.tlog": telemetry, "log.ulg": write_ulog}


@pytest.mark.parametrize("name", WRITERS)
def test_logs_give_position_and_attitude_in_the_world_of_the_origin(tmp_path, name):
    path = WRITERS[name](tmp_path / name, ANGLES, PLACES)
    track = read_log_track(path, Navigation(offset_s=10.0, origin=ORIGIN))
    assert not track.notes
    north_m = 111_170.0 * 1e-4  # of a ten-thousandth degree of latitude at 46 degrees, on the ellipsoid
    for time in (0.4, 1.0, 2.5):
        pose = track.at(time)
        np.testing.assert_allclose(pose.translation, [north_m * time, 0.0, -2 * time], atol=0.02)
        angles = pose.rotation.as_euler("ZYX", degrees=True)[::-1]
        expected = np.interp(10 + time, TIMES, ANGLES[:, 1]), -3.0, 10 * (10 + time)
        np.testing.assert_allclose(angles, expected, atol=0.02)
    assert track.at(-0.1) is None


@pytest.mark.parametrize("name", WRITERS)
def test_without_an_origin_the_first_position_is_it_and_gaps_stay(tmp_path, name):
    path = WRITERS[name](tmp_path / name, ANGLES, PLACES[(SLOW < 11) | (SLOW > 13)])
    track = read_log_track(path, OWN_CLOCK)
    np.testing.assert_allclose(track.positions_m[0], 0.0, atol=1e-9)
    assert "--origin 46.0170000 7.7500000 1673.00" in track.notes[-1]
    assert track.at(10.5) is not None
    assert track.at(12.0) is None


def test_a_log_needs_its_clock_stated(tmp_path):
    with pytest.raises(RecordingError, match=r"log\.bin.*--pose-offset-s"):
        read_log_track(dataflash(tmp_path / "log.bin", ANGLES, PLACES), Navigation())


def test_positions_go_on_across_the_antimeridian(tmp_path):
    places = PLACES.copy()
    places[:, 2] = (179.9995 + 1e-4 * np.arange(len(places)) + 180.0) % 360.0 - 180.0
    track = read_log_track(dataflash(tmp_path / "log.bin", ANGLES, places), OWN_CLOCK)
    east_m = track.positions_m[:, 1]
    assert np.all(np.diff(east_m) > -1e-6) and east_m[-1] < 200.0


def test_positions_without_a_fix_are_left_out(tmp_path):
    places = PLACES.copy()
    places[:5, 1:3] = 0.0
    track = read_log_track(dataflash(tmp_path / "log.bin", ANGLES, places), OWN_CLOCK)
    assert track.times_s[0] == pytest.approx(SLOW[5])
    assert "5 of 20 poses left out" in track.notes[0]


def test_a_log_without_satellites_has_its_local_frame(tmp_path):
    level = np.column_stack([TIMES, *np.eye(4)[:, :1] * np.ones(len(TIMES))])
    path = ulog(tmp_path / "log.ulg", level, np.column_stack([SLOW, SLOW, 0 * SLOW, -SLOW]), local=True)
    np.testing.assert_allclose(read_log_track(path, OWN_CLOCK).at(11.1).translation, [11.1, 0.0, -11.1])


@pytest.mark.parametrize("name", WRITERS)
def test_a_log_cut_short_gives_its_beginning(tmp_path, name):
    path = WRITERS[name](tmp_path / name, ANGLES, PLACES)
    cut = path.read_bytes()[:-37] if name != "log.ulg" else path.read_bytes()[:-13]
    path.write_bytes(cut)
    assert read_log_track(path, OWN_CLOCK).at(11.0) is not None


def test_a_damaged_message_that_meets_the_end_is_read_once(tmp_path):
    path, unknown = tmp_path / "log.ulg", b"\x13\0\0"  # of 19 bytes, of which 10 are there
    path.write_bytes(b"ULog\x01\x12\x35\x01" + bytes(8) + 10 * b"\x01\0I\0" + unknown + bytes(10))
    with pytest.raises(RecordingError, match=r"log\.ulg.*vehicle_attitude"):
        read_log_track(path, OWN_CLOCK)


def test_what_a_log_lacks_is_named(tmp_path):
    with pytest.raises(RecordingError, match=r"log\.bin.*ATT.*POS.*XKF1"):
        read_log_track(dataflash(tmp_path / "log.bin", ANGLES, []), OWN_CLOCK)
    with pytest.raises(RecordingError, match=r"log\.tlog.*ATTITUDE.*13\.960.*10\.000"):
        twice = telemetry(tmp_path / "log.tlog", ANGLES, PLACES).read_bytes() * 2
        (tmp_path / "log.tlog").write_bytes(twice)
        read_log_track(tmp_path / "log.tlog", OWN_CLOCK)


def test_what_a_parser_prints_of_damage_is_counted_and_not_shown(tmp_path, capfd):
    path = dataflash(tmp_path / "log.bin", ANGLES, PLACES)
    data = path.read_bytes()
    middle = data.index(b"\xa3\x95\x81", 1500)  # where a message begins
    path.write_bytes(data[:middle] + bytes(50) + data[middle:])
    track = read_log_track(path, OWN_CLOCK)
    assert (len(track.notes), track.at(12.0) is None) == (2, False)
    assert " 51 " in track.notes[0]
    (tmp_path / "noise.bin").write_bytes(b"\xa3\x95\x80" + bytes(range(256)))
    with pytest.raises(RecordingError, match=r"noise\.bin"):
        read_log_track(tmp_path / "noise.bin", OWN_CLOCK)
    assert capfd.readouterr() == ("", "")


def test_a_missing_parser_names_the_extra(tmp_path, monkeypatch):
    path = dataflash(tmp_path / "log.bin", ANGLES, PLACES)
    monkeypatch.setitem(sys.modules, "pymavlink.DFReader", None)
    with pytest.raises(ImportError, match=r"deckline\[logs\]"):
        read_log_track(path, OWN_CLOCK)


def test_the_tangent_plane_agrees_with_published_coordinates():
    # Matterhorn from Zermatt: MathWorks, Mapping Toolbox, geodetic2enu: east, north, up
    there, here = np.array([[45.976, 7.658, 4531.0]]), np.array([ORIGIN])
    offset = ecef_from_geodetic(there) - ecef_from_geodetic(here)
    np.testing.assert_allclose(ecef_from_ned(here).inv().apply(offset), [[-4556.3, -7134.8, -2852.4]], atol=0.05)


def test_attitudes_are_turned_into_the_axes_of_the_origin(tmp_path):
    rows = "".join(f"{t},60,{8 + t},0,1,0,0,0\n" for t in (0.0, 0.4))
    path = tmp_path / "poses.csv"
    path.write_text("time_s,lat_deg,lon_deg,alt_m,qw,qx,qy,qz\n" + rows)
    yaw = read_csv_track(path, Navigation(origin=(60.0, 8.0, 0.0))).at(0.4).rotation.as_euler("ZYX", degrees=True)[0]
    assert yaw == pytest.approx(-0.4 * np.sin(np.deg2rad(60.0)), abs=1e-4)  # convergence of the meridians


def test_positions_that_are_no_geodetic_ones(tmp_path):
    path = tmp_path / "poses.csv"
    path.write_text("time_s,lat_deg,lon_deg,alt_m,qw,qx,qy,qz\n0,95,0,0,1,0,0,0\n1,95,0,0,1,0,0,0\n")
    with pytest.raises(RecordingError, match=r"poses\.csv.*latitude.*95"):
        read_csv_track(path, OWN_CLOCK)
    with pytest.raises(ValueError, match=r"origin.*95"):
        Navigation(origin=(95.0, 0.0, 0.0))
