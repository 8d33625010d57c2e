import math

import msgpack
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform, Rotation

from deckline.adapters.airsim.protocol import (
    Decoder,
    ProtocolError,
    Request,
    Response,
    encode,
    encode_request,
    quote,
    read_flag,
    read_number,
    read_pose,
)
from deckline.geometry import Camera, pose
from deckline_sim.airsim_server.kinematics import Collision, Ground, VehicleMotion
from deckline_sim.airsim_server.structs import (
    camera_struct,
    collision_struct,
    geo_struct,
    multirotor_struct,
    pose_struct,
    read_geo,
    unknown_pose_struct,
)

# [0, 7, "ping", []] and [1, 7, nil, true], written by hand from the MessagePack specification
PING, PONG = b"\x94\x00\x07\xa4ping\x90", b"\x94\x01\x07\xc0\xc3"
HERE = pose((1.0, 2.0, -3.0), (0.5, 0.5, 0.5, 0.5))
coordinates = st.floats(-1000.0, 1000.0)


def decode(data, **limits):
    return list(Decoder(**limits).feed(data))


def test_messages_are_the_bytes_of_the_specification():
    assert encode_request(7, "ping", ()) == PING
    assert encode([1, 7, None, True]) == PONG
    assert decode(PING + PONG) == [Request(7, "ping", ()), Response(7, None, True)]
    assert decode(b"\x93\x02\xa4ping\x91\x05") == [Request(None, "ping", (5,))]


@given(st.lists(st.integers(1, 12), max_size=30))
def test_messages_come_out_whole_however_the_bytes_are_cut(cuts):
    data, decoder, found, at = 3 * (PING + PONG), Decoder(), [], 0
    for size in [*cuts, len(data)]:
        found += decoder.feed(data[at : at + size])
        at += size
        assert decoder.unfinished == min(at, len(data)) - sum(
            len(PING if isinstance(one, Request) else PONG) for one in found
        )
    assert found == 3 * [Request(7, "ping", ()), Response(7, None, True)]


values = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**63), 2**64 - 1) | st.floats(allow_nan=False) | st.text() | st.binary(),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(), inner, max_size=4),
    max_leaves=20,
)


@given(values)
def test_values_are_encoded_as_msgpack_itself_does(value):
    assert encode(value) == msgpack.packb(value)


def test_float_arrays_are_lists_of_single_precision_numbers():
    numbers = np.array([0.0, 1.5, -2.25, 65504.0, np.inf], dtype=np.float32)
    assert msgpack.unpackb(encode({"a": [numbers, 1]})) == {"a": [numbers.tolist(), 1]}
    assert encode(numbers)[5] == 0xCA
    with pytest.raises(TypeError, match=r"float64 \(2, 2\)"):
        encode(np.zeros((2, 2)))


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (b"GET / HTTP/1.1\r\n", "71"),
        (b"\xc1", None),
        (b"\x94\x00\x07\xa4\xff\xff\xff\xff\x90", "utf-8"),
        (b"\x94\x00\xc0\xa4ping\x90", "None, 'ping'"),
        (b"\x94\x03\x07\xa4ping\x90", "3, 7, 'ping'"),
        (b"\x90", r"\[\]"),
        (b"\x81\x01\x02", None),
        (b"\x91" * 5000, None),
        (b"\xc6\x7f\xff\xff\xff" + b"x" * 65531, "65536"),
        (b"\xdd\xff\xff\xff\xff", "4294967295 .*65536"),  # refused before the values come
        (b"\xdf\xff\xff\xff\xff", "4294967295 .*65536"),
    ],
)
def test_what_is_no_message_is_refused_with_a_reason(data, says):
    with pytest.raises(ProtocolError, match=says):
        decode(data, limit=1 << 16)


@pytest.mark.parametrize("part", [b"x" * 600, [0.5] * 67], ids=["bytes", "numbers"])
def test_messages_are_refused_from_the_limit_on(part):
    message = encode_request(1, "m", (part, part))
    assert len(decode_pieces(2 * message, len(message) + 1)) == 2
    for limit in (len(message), 600):
        with pytest.raises(ProtocolError, match=f"{limit}"):
            decode_pieces(PING + message, limit)


def decode_pieces(data, limit):
    decoder = Decoder(limit)
    return [message for at in range(0, len(data), 50) for message in decoder.feed(data[at : at + 50])]


def test_quotes_are_short_and_plain():
    assert quote("a\nb\x1b[2J") == "a\\nb\\x1b[2J"
    assert len(quote("x" * 1000)) < 70


def test_numbers_lie_between_their_limits_and_flags_are_booleans():
    assert read_number(7, "rate", 0.0, 10.0) == 7.0 and read_flag(False, "on") is False
    for value in (None, True, "5", math.nan, -1, 10.5, math.inf):
        with pytest.raises(ValueError, match=f"rate.*0 and 10.*{value!r}"):
            read_number(value, "rate", 0.0, 10.0)
    for value in (None, 1, "true"):
        with pytest.raises(ValueError, match=f"on.*{value!r}"):
            read_flag(value, "on")


@given(st.tuples(coordinates, coordinates, coordinates), st.integers(0, 2**32 - 1))
def test_poses_come_back(position, seed):
    given_pose = RigidTransform.from_components(position, Rotation.random(rng=np.random.default_rng(seed)))
    np.testing.assert_allclose(read_pose(pose_struct(given_pose), "").as_matrix(), given_pose.as_matrix(), atol=1e-12)


def test_nan_keeps_each_part():
    kept = read_pose(unknown_pose_struct(), "", HERE)
    np.testing.assert_allclose(kept.as_matrix(), HERE.as_matrix(), atol=1e-12)
    one = pose_struct(pose((7.0, 8.0, -9.0), (1.0, 0.0, 0.0, 0.0)))
    one["orientation"]["x_val"] = math.nan
    mixed = read_pose(one, "", HERE)
    np.testing.assert_allclose(mixed.translation, [7.0, 8.0, -9.0])
    np.testing.assert_allclose(mixed.rotation.as_matrix(), HERE.rotation.as_matrix(), atol=1e-12)
    with pytest.raises(ValueError, match="camera: quaternion"):
        read_pose(one, "camera")


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"position": {"x_val": math.inf, "y_val": 0, "z_val": 0}}, "drone: position.*inf"),
        ({"position": {"x_val": "1", "y_val": 0, "z_val": 0}}, "drone: position.*'1'"),
        ({"position": [1, 2, 3]}, r"drone: position.*x_val, y_val, z_val.*\[1, 2, 3\]"),
        ({"orientation": None}, "drone: orientation.*w_val.*None"),
        ({"orientation": dict.fromkeys(("w_val", "x_val", "y_val", "z_val"), 0)}, r"drone: .*0\.0, 0\.0"),
    ],
)
def test_what_is_no_pose_is_named(change, says):
    with pytest.raises(ValueError, match=says):
        read_pose(pose_struct(HERE) | change, "drone", HERE)
    with pytest.raises(ValueError, match=r"drone: position.*None"):
        read_pose(None, "drone", HERE)


def test_the_projection_matrix_is_airsims():
    camera = Camera.from_fov(1280, 720, math.radians(70.0))
    matrix = np.array(camera_struct(HERE, camera)["proj_mat"]["matrix"])
    ahead, right, down = 30.0, 4.0, -2.0
    x, y, _, w = matrix @ [ahead, right, down, 1.0]
    u, v = camera.project([[right, down, ahead]])[0]
    # AirSim's w points backwards: the pixel is at the negative of both, y upwards
    assert -x / w == pytest.approx((u + 0.5) / 640.0 - 1.0)
    assert -y / w == pytest.approx(1.0 - (v + 0.5) / 360.0)


def test_geo_points_are_where_the_sphere_has_them():
    mile = geo_struct((1852.0, 0.0, -100.0), (45.0, 10.0, 5.0))
    assert mile["latitude"] == pytest.approx(45.0 + 1 / 60, rel=1e-4) and mile["altitude"] == 105.0
    np.testing.assert_allclose(read_geo(*mile.values(), (45.0, 10.0, 5.0)), [1852.0, 0.0, -100.0], atol=1e-6)
    east = geo_struct((0.0, 1852.0, 0.0), (60.0, 10.0, 5.0))
    assert east["longitude"] - 10.0 == pytest.approx(2 / 60, rel=5e-3)  # the parallel is half as long there


def test_states_have_the_fields_of_the_published_client():
    airsim = pytest.importorskip("cosysairsim")
    motion = VehicleMotion(1.0, HERE, np.array([3.0, 4.0, 0.0]), np.zeros(3), np.zeros(3), True, Ground("Deck", 0.0))
    state = airsim.MultirotorState.from_msgpack(multirotor_struct(motion, (45.0, 10.0, 5.0), 9))
    for kind, value in ((airsim.MultirotorState, state), (airsim.CollisionInfo(), state.collision)):
        assert {name for name in dir(kind) if not name.startswith(("_", "to_", "from_"))} == set(vars(value))
    assert state.kinematics_estimated.linear_velocity.get_length() == 5.0
    assert state.landed_state == airsim.LandedState.Landed and not state.collision.has_collided
    hit = airsim.CollisionInfo.from_msgpack(
        collision_struct(Collision("Deck", 1.0, np.ones(3), np.array([0, 0, -1])), 9)
    )
    assert (hit.has_collided, hit.object_name, hit.normal.z_val, hit.position.x_val) == (True, "Deck", -1.0, 1.0)
