import msgpack
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from deckline.adapters.airsim.extent import Extent
from deckline.adapters.airsim.protocol import (
    Decoder,
    ProtocolError,
    Request,
    Response,
    encode,
    encode_request,
    encode_response,
    quoted,
)

# [0, 7, "ping", []] and [1, 7, nil, true], written by hand from the MessagePack specification
PING, PONG = b"\x94\x00\x07\xa4ping\x90", b"\x94\x01\x07\xc0\xc3"


def decoded(data, **limits):
    return list(Decoder(**limits).feed(data))


def test_messages_are_the_bytes_of_the_specification():
    assert encode_request(7, "ping", ()) == PING
    assert encode_response(7, None, True) == PONG
    assert decoded(PING + PONG) == [Request(7, "ping", ()), Response(7, None, True)]
    assert decoded(b"\x93\x02\xa4ping\x91\x05") == [Request(None, "ping", (5,))]


@given(st.lists(st.integers(1, 12), max_size=30))
def test_messages_come_out_whole_however_the_bytes_are_cut(cuts):
    data, decoder, found, at = 3 * (PING + PONG), Decoder(), [], 0
    for size in [*cuts, len(data)]:
        found += decoder.feed(data[at : at + size])
        at += size
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
    with pytest.raises(TypeError, match="float arrays of one dimension"):
        encode(np.zeros((2, 2)))


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (b"GET / HTTP/1.1\r\n", "no msgpack-rpc message: 71"),
        (b"\xc1", "no msgpack-rpc"),
        (b"\x94\x00\x07\xa4\xff\xff\xff\xff\x90", "no msgpack-rpc: 'utf-8' codec"),
        (b"\x94\x00\xc0\xa4ping\x90", "no msgpack-rpc message"),
        (b"\x94\x03\x07\xa4ping\x90", "no msgpack-rpc message"),
        (b"\x90", "no msgpack-rpc message"),
        (b"\x81\x01\x02", "no msgpack-rpc: int is not allowed for map key"),
        (b"\x91" * 5000, "nested too deeply"),
        (b"\xc6\x04\x00\x00\x00", "a message of 67108869 bytes or more"),  # it says it has 64 MiB
        (b"\x94\x00\x07\xa1m\x91\xc6\x03\xff\xff\xff", "a message of 67108[0-9]* bytes or more"),
        (b"\xdb\x7f\xff\xff\xff", "bytes or more"),
        (b"\xdd\xff\xff\xff\xff", "bytes or more"),
        (b"\xdd\x00\x10\x00\x00", "a message of 1048576 values or more"),
        (b"\xdf\xff\xff\xff\xff", "bytes or more"),
    ],
)
def test_what_is_no_message_is_refused_with_a_reason(data, says):
    with pytest.raises(ProtocolError, match=says):
        decoded(data)


def test_messages_are_refused_from_the_limit_on():
    message = encode_request(1, "m", (b"x" * 600, b"x" * 600))
    for items_limit in (10, None):
        assert len(decoded(message, limit=len(message) + 1, items_limit=items_limit)) == 1
        decoder = Decoder(limit=len(message), items_limit=10)
        with pytest.raises(ProtocolError, match="bytes or more"):
            list(decoder.feed(message[:620]))  # where the second value says how long it is
    with pytest.raises(ProtocolError, match="a message of 600 bytes or more"):
        decoded(message, limit=600, items_limit=None)


@given(st.lists(values, min_size=1, max_size=5), st.lists(st.integers(1, 9), max_size=20))
def test_the_announced_extent_is_the_real_one(many, cuts):
    messages = [encode(value) for value in many]
    largest = max(map(len, messages))
    below = Extent(largest + 1, 10**6)
    assert not pieces(below, b"".join(messages), cuts)
    assert below.largest == largest and not below.midway
    assert pieces(Extent(largest, 10**6), b"".join(messages), cuts)


def pieces(extent, data, cuts):
    at, said = 0, ""
    for size in [*cuts, len(data)]:
        said, at = said or extent.follow(data[at : at + size]), at + size
    return said


def test_quotes_are_short_and_plain():
    assert quoted("a\nb\x1b[2J") == "a\\nb\\x1b[2J"
    assert len(quoted("x" * 1000)) < 70
