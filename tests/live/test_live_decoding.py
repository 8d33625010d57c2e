"""Pictures of MPEG transport streams: whole, damaged, of senders that change, and of what is no stream."""

import io
import re
import socket
import threading
import time
from bisect import bisect_right
from contextlib import closing, contextmanager
from fractions import Fraction
from itertools import accumulate
from types import SimpleNamespace

import av
import numpy as np
import pytest
from loopback import Sender, free_port

from deckline.live import decoding
from deckline.live.clock import WallClock
from deckline.live.datagrams import PACKET, RTP_HEADER, is_transport, rtp_payload
from deckline.live.opening import is_camera, open_camera
from deckline.live.source import Captured
from deckline.recording import BadFrame, RecordingError

WIDTH, HEIGHT, COUNT, GOP = 320, 180, 18, 6
RTP = bytes([0x80, 33]) + bytes(10)


def make_stream(codec="libx264", noise=20, omit_length="1"):
    """Packets of COUNT pictures, 30 a second from 1 s on."""
    buffer, rng = io.BytesIO(), np.random.default_rng(0)
    muxer = {"omit_video_pes_length": omit_length}  # of the pictures, as FFmpeg does and GStreamer does not
    with av.open(buffer, "w", format="mpegts", container_options=muxer) as container:
        options = {"preset": "ultrafast", "tune": "zerolatency"} if codec == "libx264" else {}
        coded = container.add_stream(codec, rate=30, options=options)
        coded.width, coded.height, coded.pix_fmt, coded.gop_size = WIDTH, HEIGHT, "yuv420p", GOP
        for index in range(COUNT):
            image = rng.integers(100, 100 + noise, (HEIGHT, WIDTH, 3), dtype=np.uint8)
            picture = av.VideoFrame.from_ndarray(image, format="rgb24")
            picture.pts, picture.time_base = 30 + index, Fraction(1, 30)
            container.mux(coded.encode(picture))
        container.mux(coded.encode())
    return buffer.getvalue()


def reference(data):
    """Presentation time of each picture -> the position of its first packet and its colours, as FFmpeg decodes them."""
    with av.open(io.BytesIO(data), format="mpegts") as container:
        packets = list(container.demux(video=0))
        positions = {packet.pts: packet.pos for packet in packets if packet.size}
        frames = [frame for packet in packets for frame in packet.decode()]
    return {frame.time: (positions[frame.pts], frame.to_ndarray(format="rgb24")) for frame in frames}


def split(data, size=7 * PACKET):
    return [data[start : start + size] for start in range(0, len(data), size)]


class Datagrams:
    """A receiver of prepared datagrams: (payload, whether a sender begins with it). Its clock counts them."""

    def __init__(self, *senders):
        self.received = 0
        self._items = [(payload, index == 0) for sender in senders for index, payload in enumerate(sender)]

    def receive(self, timeout_s):
        self.received += 1
        return self._items[self.received - 1] if self.received <= len(self._items) else None


@pytest.fixture
def decode(monkeypatch):
    """Decode the datagrams of senders one after the other; times are numbers of datagrams, from 1 on."""

    def run(*senders, anew=10_000.0):
        datagrams = Datagrams(*senders)
        monkeypatch.setattr(decoding, "ANEW_S", anew)
        monkeypatch.setattr(decoding, "time", SimpleNamespace(monotonic=lambda: float(datagrams.received)))
        return list(decoding.decode_stream(datagrams, threading.Event()))

    return run


@pytest.mark.parametrize("size", [188, 1316, 1472, 60000])
@pytest.mark.parametrize("codec, omit_length", [("libx264", "1"), ("libx264", "0"), ("mpeg2video", "1")])
def test_pictures_are_those_of_ffmpeg_and_arrive_with_their_first_datagram(decode, codec, omit_length, size):
    data = make_stream(codec, omit_length=omit_length)
    datagrams, expected = split(data, size), reference(data)
    starts = list(accumulate(map(len, datagrams), initial=0))
    pictures = decode(datagrams)
    assert len(pictures) >= COUNT - 2  # the last one ends where no other begins
    for picture in pictures:
        position, colours = expected[picture.presented_s]
        np.testing.assert_array_equal(picture.image.to_ndarray(format="rgb24"), colours)
        assert picture.arrival_s == bisect_right(starts, position)
        assert picture.waited and not picture.damage


def test_a_lost_datagram_is_noticed_and_leaves_no_trace_after_the_next_key_picture(decode):
    data = make_stream()
    datagrams, expected = split(data), reference(data)
    for lost in range(2, len(datagrams) - 2):
        refused, clean = True, 0
        for picture in decode(datagrams[:lost] + datagrams[lost + 1 :]):
            refused = bool(picture.damage) or (refused and not picture.image.key_frame)
            if not refused:
                clean += 1
                colours = expected[picture.presented_s][1]
                np.testing.assert_array_equal(picture.image.to_ndarray(format="rgb24"), colours)
        assert COUNT - GOP - 3 <= clean < COUNT - 1


def test_another_sender_begins_a_new_stream_of_another_codec(decode):
    pictures = decode(split(make_stream()), split(make_stream("mpeg2video")), split(make_stream()))
    restarts = [n for n, picture in enumerate(pictures) if picture.presented_s == pictures[0].presented_s]
    assert len(restarts) == 3 and len(pictures) >= 3 * (COUNT - 2)
    assert not any(picture.damage for picture in pictures)
    assert all(pictures[n].image.key_frame for n in restarts)


def test_a_stream_without_a_decodable_picture_is_opened_anew(decode):
    datagrams = split(make_stream())
    idle = 80 * [bytes(7 * PACKET)]
    assert decode(datagrams + idle + datagrams, anew=120.0)[-1].arrival_s > len(datagrams + idle)
    assert decode(datagrams + idle + datagrams, anew=40.0)[-1].arrival_s < len(datagrams) + 40


@pytest.mark.parametrize("seed", range(3))
def test_garbage_is_no_other_error(decode, seed):
    rng = np.random.default_rng(seed)
    data = bytearray(make_stream())
    for start in range(0, len(data), PACKET):  # every packet keeps its sync byte
        for place in rng.integers(1, PACKET, 4):
            data[start + place] = rng.integers(0, 256)
    for datagrams in (split(bytes(data)), split(b"".join(b"\x47" + rng.bytes(PACKET - 1) for _ in range(500)))):
        assert not any(picture.image is not None and not picture.damage for picture in decode(datagrams)[COUNT:])


PLAYLIST = b"#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\nfile:///%s\n#EXT-X-ENDLIST\n"
BAD = {
    "one byte": b"G",
    "half a packet": b"G" + bytes(93),
    "no sync byte": bytes(PACKET),
    "a second packet without sync byte": b"G" + bytes(2 * PACKET - 1),
    "a line of text": b"GET / HTTP/1.1\r\n\r\n",
    "a playlist": (PLAYLIST % b"etc/passwd").ljust(7 * PACKET, b"\n"),
    "a list for concatenation": b"ffconcat version 1.0\nfile /etc/passwd\n".ljust(7 * PACKET),
    "RTP without packets": b"\x80\x21" + bytes(10),
    "RTP with 15 sources and none there": b"\x8f\x21" + bytes(11),
    "65,000 bytes": (254 * bytes(range(256)))[:65_000],
}


@pytest.mark.parametrize("name", BAD)
def test_no_sender_begins_with_other_data_and_its_own_are_skipped(decode, name):
    assert not is_transport(BAD[name]) and not is_transport(rtp_payload(BAD[name]))
    datagrams = split(make_stream())
    assert len([each for each in decode([datagrams[0], BAD[name], *datagrams]) if not each.damage]) >= COUNT - GOP - 2


def test_transport_packets_are_bare_or_in_rtp():
    data = make_stream()
    for size in (PACKET, 7 * PACKET, 1472):
        for datagram in split(data[: 10 * 1472 // size * size], size):
            assert is_transport(datagram) and rtp_payload(RTP + datagram) == datagram
    assert rtp_payload(data[: 7 * PACKET]) == b""
    assert rtp_payload(bytes([0x80, 96]) + bytes(RTP_HEADER - 2) + data[: 7 * PACKET]) == b""


@contextmanager
def captured(address):
    """A camera, the frames and damaged frames that it delivers in a thread, and the thread."""
    camera, items = open_camera(address, None, WallClock(), log=lambda line: None), []

    def collect():
        for item in camera.captures():
            items.append(item)

    thread = threading.Thread(target=collect)
    thread.start()
    try:
        yield camera, items, thread
    finally:
        camera.stop()
        thread.join()
        camera.close()


PROTOCOLS = [
    ("udp://{}", "mpegts", "pkt_size=1316"),
    ("udp://{}", "mpegts", "pkt_size=1472"),
    ("rtp://{}", "rtp_mpegts", "pkt_size=1472"),
]


@pytest.mark.parametrize("address, muxer, option", PROTOCOLS)
@pytest.mark.parametrize("host", ["127.0.0.1", "239.255.77.1"])
def test_what_ffmpeg_sends_over_a_network_is_received(address, muxer, option, host):
    address = address.format(f"{host}:{free_port()}")
    with captured(address) as (_, items, _):
        try:
            container = av.open(f"{address}?{option}&ttl=0", "w", format=muxer)
        except OSError as error:
            pytest.skip(f"no multicast here: {error}")
        with container:
            coded = container.add_stream("libx264", rate=30, options={"preset": "ultrafast", "tune": "zerolatency"})
            coded.width, coded.height, coded.pix_fmt, coded.gop_size = WIDTH, HEIGHT, "yuv420p", GOP
            rng = np.random.default_rng(0)
            for index in range(300):
                image = rng.integers(100, 120, (HEIGHT, WIDTH, 3), dtype=np.uint8)
                picture = av.VideoFrame.from_ndarray(image, format="rgb24")
                picture.pts, picture.time_base = index, Fraction(1, 30)
                container.mux(coded.encode(picture))
                if sum(isinstance(item, Captured) for item in items) > 5:
                    break
                time.sleep(1 / 30)
    frames = [item for item in items if isinstance(item, Captured)]
    assert len(frames) > 5 and frames[0].frame.image_rgb.shape == (HEIGHT, WIDTH, 3)
    assert not any(isinstance(item, BadFrame) for item in items[-3:])


def test_a_stop_ends_a_wait_for_a_sender_and_for_pictures():
    port = free_port()
    with captured(f"udp://127.0.0.1:{port}") as (camera, _, thread):
        camera.stop()
        thread.join(10.0)
        assert not thread.is_alive()
    with Sender(port), captured(f"udp://127.0.0.1:{port}") as (camera, items, thread):
        while not items:
            thread.join(0.01)
        camera.stop()
        thread.join(10.0)
        assert not thread.is_alive()


def test_pictures_beyond_the_bound_are_refused_undecoded(decode, monkeypatch):
    for options in (decoding.BOUNDS, decoding.MPEG_TS):
        monkeypatch.setitem(options, "max_pixels", str(WIDTH * HEIGHT // 2))
    pictures = decode(split(make_stream()))
    assert pictures and all(picture.image is None and picture.damage for picture in pictures)


FILES = ["file:///etc/hosts", "/etc/hosts", "http://h/a.m3u8", "https://h/a.m3u8", "hls+http://h/a", "concat:a|b"]
FILES += ["data:text/plain,a", "subfile,,start,0,end,9,,:/etc/hosts", "udp:/etc/hosts", "rtp:///etc/hosts", "pipe:0"]
FILES += ["srt:/127.0.0.1:9000", "rtsp:/10.0.0.2", "rtp:5004"]
FILES += ["camera:x", "camera:0?gain=3", "/dev/null", "udp://127.0.0.1", "udp://u@h:5/x"]


@pytest.mark.parametrize("address", FILES)
def test_no_address_is_a_file_or_a_playlist(address):
    with pytest.raises(ValueError, match=re.escape(address)):
        open_camera(address, None, WallClock())
    assert not is_camera(address) or address.startswith(("udp:", "rtp:", "srt:", "rtsp:", "camera:"))


@pytest.mark.parametrize("target", ["file://{}", "http://127.0.0.1:{port}/a.m3u8", "udp://127.0.0.1:{port}", "{}"])
def test_an_rtsp_server_leads_to_no_file_and_no_playlist(target, tmp_path):
    (tmp_path / "film.ts").write_bytes(make_stream())
    with closing(socket.create_server(("127.0.0.1", 0))) as server, closing(socket.create_server(("", 0))) as elsewhere:
        location = target.format(tmp_path / "film.ts", port=elsewhere.getsockname()[1])

        def redirect():
            connection = server.accept()[0]
            request = connection.recv(4096).decode()
            sequence = next(line for line in request.splitlines() if line.startswith("CSeq"))
            connection.sendall(f"RTSP/1.0 302 Found\r\n{sequence}\r\nLocation: {location}\r\n\r\n".encode())
            connection.recv(4096)
            connection.close()

        threading.Thread(target=redirect, daemon=True).start()
        camera = open_camera(f"rtsp://127.0.0.1:{server.getsockname()[1]}/a", None, WallClock())
        with pytest.raises((av.error.FFmpegError, OSError)):
            list(camera._pictures())
        elsewhere.setblocking(False)
        with pytest.raises(BlockingIOError):
            elsewhere.accept()


def test_srt_that_ffmpeg_lacks_is_named_without_its_passphrase():
    try:
        camera = open_camera("srt://me@10.0.0.2:9000?passphrase=secret0123", None, WallClock())
    except RecordingError as error:
        assert "srt://10.0.0.2:9000" in str(error) and "secret" not in str(error)
    else:
        assert camera.name == "srt://10.0.0.2:9000"
