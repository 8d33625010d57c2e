"""Coded pictures out of transport streams that another muxer wrote, whole and damaged."""

import io
from fractions import Fraction

import av
import numpy as np
import pytest

from deckline.live.transport import PACKET, Demultiplexer, make_decoder, transport_packets

WIDTH, HEIGHT, COUNT = 320, 180, 12


def stream(codec="libx264", noise=20):
    """Packets of COUNT pictures, 30 a second from 1 s on, and the pictures' coded sizes."""
    buffer, rng = io.BytesIO(), np.random.default_rng(0)
    with av.open(buffer, "w", format="mpegts") as container:
        options = {"preset": "ultrafast", "tune": "zerolatency"} if codec == "libx264" else {}
        coded = container.add_stream(codec, rate=30, options=options)
        coded.width, coded.height, coded.pix_fmt, coded.gop_size = WIDTH, HEIGHT, "yuv420p", 6
        for index in range(COUNT):
            image = rng.integers(100, 100 + noise, (HEIGHT, WIDTH, 3), dtype=np.uint8)
            picture = av.VideoFrame.from_ndarray(image, format="rgb24")
            picture.pts, picture.time_base = 30 + index, Fraction(1, 30)
            container.mux(coded.encode(picture))
        container.mux(coded.encode())
    return buffer.getvalue()


def feed(data, step=7 * PACKET):
    demultiplexer, found = Demultiplexer(), []
    for number, start in enumerate(range(0, len(data), step)):
        found += [(number, unit) for unit in demultiplexer.feed(data[start : start + step], float(number))]
    return demultiplexer, found


def decode(codec, units):
    decoder, pictures = make_decoder(codec), []
    for unit in units:
        packet = av.Packet(unit.data)
        packet.pts = unit.presented
        pictures += decoder.decode(packet)
    return pictures


@pytest.mark.parametrize("codec, name", [("libx264", "h264"), ("mpeg2video", "mpeg2video")])
def test_pictures_are_those_that_ffmpeg_demultiplexes(codec, name):
    data = stream(codec)
    demultiplexer, found = feed(data)
    units = [unit for _, unit in found]
    assert demultiplexer.codec == name
    pictures = decode(name, units)
    with av.open(io.BytesIO(data)) as container:
        expected = list(container.decode(video=0))
    assert len(pictures) >= COUNT - 1  # the last one may end where no other begins
    for picture, wanted in zip(pictures, expected, strict=False):
        np.testing.assert_array_equal(picture.to_ndarray(format="rgb24"), wanted.to_ndarray(format="rgb24"))
    steps = np.diff([unit.presented for unit in units])
    assert set(steps) == {3000}  # 90 kHz
    assert not any(unit.damaged for unit in units)


def test_a_picture_is_there_with_its_last_packet():
    data = stream()
    _, found = feed(data, PACKET)
    begins = [int(unit.arrival_s) for _, unit in found]
    early = [number < begin for (number, _), begin in zip(found, begins[1:], strict=False)]
    assert np.mean(early) > 0.8


def test_a_lost_packet_damages_the_picture_it_belonged_to():
    data = stream()
    packets = [data[start : start + PACKET] for start in range(0, len(data), PACKET)]
    video = [
        n for n, p in enumerate(packets) if not p[1] & 0x40 and (p[1] & 0x1F, p[2]) == (1, 0) and p[3] & 0x30 == 0x10
    ]
    lost = video[len(video) // 2]
    _, found = feed(b"".join(packets[:lost] + packets[lost + 1 :]), PACKET)
    damaged = [unit.presented for _, unit in found if unit.damaged]
    begin = [unit.presented for number, unit in feed(data, PACKET)[1] if unit.arrival_s < lost]
    assert damaged == [begin[-1]]


def test_stuffing_in_the_middle_of_pictures_costs_one_picture():
    data = bytearray(stream())
    packets = [data[start : start + PACKET] for start in range(0, len(data), PACKET)]
    changed = []
    for packet in packets:
        is_video = (packet[1] & 0x1F, packet[2]) == (1, 0)
        if not is_video or packet[1] & 0x40 or packet[3] & 0x30 != 0x10:
            changed.append(packet)
            continue
        count = packet[3] & 0x0F  # 184 bytes of payload become 92 and 92, both stuffed
        for half in (packet[4:96], packet[96:]):
            changed.append(packet[:3] + bytes([0x30 | count, 91, 0]) + bytes([0xFF] * 90) + half)
    numbers, renumbered = -1, []
    for packet in changed:
        if (packet[1] & 0x1F, packet[2]) == (1, 0) and packet[3] & 0x10:
            numbers = (numbers + 1) % 16
            packet = packet[:3] + bytes([packet[3] & 0xF0 | numbers]) + packet[4:]
        renumbered.append(bytes(packet))
    assert {len(packet) for packet in renumbered} == {PACKET}
    units = [unit for _, unit in feed(b"".join(renumbered))[1]]
    whole = {unit.presented: unit.data for _, unit in feed(bytes(data))[1]}
    same = [unit.data == whole[unit.presented] for unit in units if unit.presented in whole]
    assert sum(not one for one in same) <= 1
    assert len(same) >= COUNT - 2


@pytest.mark.parametrize("seed", range(3))
def test_garbage_is_no_error(seed):
    rng = np.random.default_rng(seed)
    data = bytearray(stream())
    for start in range(0, len(data), PACKET):  # every packet keeps its sync byte
        places = rng.integers(1, PACKET, 4)
        for place in places:
            data[start + place] = rng.integers(0, 256)
    feed(bytes(data))
    feed(b"".join(b"\x47" + rng.bytes(PACKET - 1) for _ in range(500)))


def test_a_datagram_is_a_transport_stream_bare_or_in_rtp():
    packets = stream()[: 7 * PACKET]
    header = bytes([0x80, 33]) + bytes(10)
    assert transport_packets(packets) == packets
    assert transport_packets(header + packets) == packets
    assert transport_packets(bytes([0x80, 96]) + bytes(10) + packets) == b""
    for other in (b"", b"\x47", packets[:-1], b"garbage" * 200):
        assert transport_packets(other) == b""
