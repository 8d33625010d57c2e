"""The dashboard in a browser, on a streamed approach; what it keeps, and who may ask for it."""

import json
import re
import select
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.request
from contextlib import ExitStack
from dataclasses import replace

import cv2
import numpy as np
import pytest

from approach_scene import LEFT, RIGHT, STILL, chain, frame, points
from deckline.adapters.dashboard.connections import CONNECTIONS
from deckline.adapters.dashboard.server import Dashboard
from deckline.adapters.dashboard.snapshots import Memory, Snapshot, dehaze, make_snapshot
from deckline.cli.main import main
from deckline.config import Approach, Models
from deckline.dehaze import DEHAZERS
from deckline.flight import Flight
from deckline.live.pipeline import LiveSession, Outputs
from deckline.live.source import Captured, LiveSource
from deckline.report.advice import CHECK, advise
from deckline.report.records import frame_record
from deckline.types import Detection, Status
from picture_scene import picture_result

CHROMIUM = shutil.which("chromium")
STEP_S = 0.1
WAIT_MS = 30_000
STALE = {"status": "stale", "seen": "none", "reason": "no frame for 0.30 s", "guidance": {}, "protection": None}
STALE |= {"file": None, "time_s": None, "flags": [{"name": "stale", "reason": "no frame for 0.30 s"}]}


class Flown(LiveSource):
    """An approach that begins again and again, and stalls when told to."""

    def __init__(self) -> None:
        super().__init__("approach")
        self.stalled = threading.Event()

    def captures(self):
        index = 0
        while not self.wait_for_stop(STEP_S):
            if not self.stalled.is_set():
                seen = frame(index % 60, 400.0 - index % 300 * 1.2, runway=False)

                now_s = time.monotonic()
                yield Captured(replace(seen, time_s=now_s, truth=None), now_s)
                index += 1


class Seeing(Flight):
    """Detects the lines exactly where they are."""

    def __call__(self, at):
        return super().__call__(at, detection=Detection(points(at, LEFT), points(at, RIGHT)))


class Flying:
    """A session with a dashboard; one a process, as NiceGUI is."""

    def __init__(self) -> None:
        self.source, self.sent, self.switched, self.refuses = Flown(), [], [], False
        config = replace(STILL, models=Models(dehazer="veil", detector="ufld"))
        self.board = Dashboard("127.0.0.1:0", "approach", config, True, self._record)
        outputs = Outputs(lambda record: self.sent.append(record["status"]), print, views=(self.board.view,))
        self.session = LiveSession(self.source, Seeing.from_config(config), outputs, stale_s=0.5)
        self.thread = threading.Thread(target=self.session.run, daemon=True)
        self.thread.start()

    def _record(self, on):
        if self.refuses:
            raise ValueError("the disk is full")
        self.switched.append(on)

    def close(self):
        self.session.stop()
        self.thread.join()
        self.board.close()


@pytest.fixture(scope="module")
def flying():
    session = Flying()
    yield session
    session.close()


@pytest.fixture(scope="module")
def browser():
    if CHROMIUM is None:
        pytest.skip("Chromium is not installed")
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        started = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield started
        started.close()


@pytest.fixture
def page(flying, browser):
    shown = browser.new_page(viewport={"width": 1280, "height": 720})
    shown.set_default_timeout(WAIT_MS)
    shown.errors, shown.hosts = [], set()
    shown.on("pageerror", lambda error: shown.errors.append(str(error)))
    shown.on("console", lambda line: shown.errors.append(line.text) if line.type in ("error", "warning") else None)
    shown.on("request", lambda request: shown.hosts.add(re.sub(r"^(\w+:(//[^/]*)?).*", r"\1", request.url)))
    shown.goto(flying.board.url)
    wait(shown, "#lateral")
    yield shown
    assert shown.errors == []
    assert shown.hosts <= {flying.board.url, "blob:", "data:"}
    shown.close()


def wait(page, selector):
    page.wait_for_selector(selector, state="attached")


def holds(page, condition):
    page.wait_for_function(condition)


def text(page, selector):
    return page.text_content(selector).strip()


def test_a_browser_follows_an_approach(page):
    assert text(page, "#status") in ("OK", "UNVERIFIED")
    holds(page, "Math.abs(document.querySelector('#lateral').dataset.dots - -0.6) < 0.05")  # 3 m right, 5 m a dot
    assert float(re.match(r"[\d.]+", text(page, "#age"))[0]) < 3.0
    wait(page, "#whole image[href^=blob]")
    assert {"left", "right", "centre"} <= {
        line.get_attribute("class").split()[0] for line in page.query_selector_all("#whole line")
    }
    wait(page, "#deck image[href^=blob]")
    for selector in (".tile .number", "#range .value"):
        before = page.query_selector_all(selector)[-1].text_content()
        holds(page, f"[...document.querySelectorAll('{selector}')].at(-1).textContent !== '{before}'")
    holds(page, "document.querySelector('.plot .curve').getAttribute('d').length > 100")
    dark = page.evaluate("getComputedStyle(document.body).backgroundColor")
    page.keyboard.press("c")
    holds(page, f"getComputedStyle(document.body).backgroundColor !== '{dark}'")


def test_a_picture_is_dehazed_on_request(page):
    wait(page, "#whole image[href^=blob]")
    page.keyboard.press("d")
    holds(page, "/^(dehazed: veil|not dehazed)/.test(document.querySelector('#whole .caption').textContent)")
    page.keyboard.press("d")
    holds(page, "!document.querySelector('#whole .caption').textContent.includes('dehazed')")
    assert page.get_attribute("#whole image", "href").startswith("blob:")


def test_a_stalled_source_is_old_and_grows_older(flying, page):
    flying.source.stalled.set()
    try:
        holds(page, "document.querySelector('#status').textContent.trim() === 'STALE'")
        wait(page, ".board.old #lateral")  # greyed out
        first = page.evaluate("parseFloat(document.querySelector('#age').textContent)")
        holds(page, f"parseFloat(document.querySelector('#age').textContent) > {first} + 0.5")
        assert "go around" in text(page, "#advice").lower()
    finally:
        flying.source.stalled.clear()
    wait(page, ".board:not(.old)")


def test_runway_widths_leave_no_tile_empty_and_the_pose_is_tagged(flying, page):
    result = picture_result()
    flying.source.stalled.set()
    try:
        holds(page, "document.querySelector('#status').textContent.trim() === 'STALE'")
        flying.board.view(result, frame_record(result, Approach()))
        wait(page, "#pose")
        tiles = [tile.text_content() for tile in page.query_selector_all(".tile")]
        assert [tile.split("–")[0][:7] for tile in tiles] == ["LATERAL", "HEIGHT,", "HEADING", "TO RAMP"]
        assert "0.19" in tiles[0] and "0.94" in tiles[1] and not any("not known" in tile for tile in tiles)
        assert text(page, ".face .unit") == "dot 0.25 widths"
        assert float(page.get_attribute("#lateral", "data-dots")) == pytest.approx(-3.0 / 16.0 / 0.25, abs=0.02)
    finally:
        flying.source.stalled.clear()
    wait(page, ".board:not(.old)")


@pytest.mark.parametrize(
    "size", [(1920, 1080), (1366, 768), (1024, 768), (800, 900), (700, 1000), (390, 844)], ids=lambda size: f"{size[0]}"
)
def test_no_text_is_cut_at_any_size(page, size):
    page.set_viewport_size({"width": size[0], "height": size[1]})
    wait(page, "#whole image[href^=blob]")
    cut = page.evaluate(
        """() => [...document.querySelectorAll(".board p, .board h2, .board span, .board small")]
            .filter((one) => one.clientWidth && one.scrollWidth > one.clientWidth + 1).map((one) => one.textContent)"""
    )
    assert cut == []
    outside = page.evaluate(
        """() => [...document.querySelectorAll(".tile p, .tag, .age, .advice, footer button")].filter((one) => {
            const box = one.getBoundingClientRect();
            return box.width && (box.left < -1 || box.right > innerWidth + 1);
        }).map((one) => one.textContent)"""
    )
    assert outside == []


def test_connections_are_bounded_and_the_flight_goes_on(flying):
    address = ("127.0.0.1", int(flying.board.url.rsplit(":", 1)[1]))
    before = len(flying.sent)
    with ExitStack() as stack:
        idle = [stack.enter_context(socket.create_connection(address, timeout=30)) for _ in range(CONNECTIONS + 20)]
        refused, until = 0, time.monotonic() + 60
        while refused < 20 and time.monotonic() < until:  # which ones depends on when the last test's page is closed
            for one in select.select(idle, [], [], 1.0)[0]:
                assert one.recv(64).startswith(b"HTTP/1.1 503")
                idle.remove(one)
                refused += 1
        assert refused >= 20
        while len(flying.sent) == before and time.monotonic() < until:
            time.sleep(0.05)
    assert len(flying.sent) > before


def test_it_pauses_and_looks_back_while_guidance_goes_on(flying, page):
    wait(page, "#whole image[href^=blob]")
    page.keyboard.press(" ")
    wait(page, "#past")
    distance, sent = text(page, "#range .value"), len(flying.sent)
    holds(page, "parseFloat(document.querySelector('#past').textContent.slice(6)) > 1")
    assert text(page, "#range .value") == distance and len(flying.sent) > sent
    for _ in range(12):
        page.keyboard.press("ArrowLeft")
    holds(page, f"document.querySelector('#range .value').textContent !== '{distance}'")
    page.keyboard.press("End")
    page.wait_for_selector("#past", state="detached")


def test_the_record_button(flying, page):
    page.keyboard.press("r")
    wait(page, "#recording")
    flying.refuses = True
    page.click("#record")
    wait(page, ".q-notification")
    assert "the disk is full" in text(page, ".q-notification") and flying.switched == [True]
    flying.refuses = False


def test_reloads_a_second_browser_and_one_that_leaves_stop_nothing(flying, browser, page):
    from nicegui import Client

    leaving = browser.new_page()
    leaving.goto(flying.board.url, wait_until="commit")
    leaving.close()
    other = browser.new_page()
    other.goto(flying.board.url)
    sent = len(flying.sent)
    for _ in range(10):
        page.reload()
        wait(page, "#lateral")
    for shown in (page, other):
        holds(shown, "document.querySelector('#status').textContent.trim() !== 'STALE'")
    other.close()
    end_s = time.monotonic() + 30
    while len(Client.instances) > 2 and time.monotonic() < end_s:  # this page, and one that never came
        time.sleep(0.1)
    assert len(Client.instances) <= 2 and len(flying.sent) > sent and flying.thread.is_alive()


@pytest.mark.parametrize(
    ("path", "headers", "status"),
    [
        ("/", {"Origin": "http://elsewhere.example"}, 403),
        ("/", {"Host": "elsewhere.example"}, 400),
        ("/snapshot/999999", {}, 404),
        ("/picture/0/other", {}, 404),
    ],
)
def test_who_may_ask_for_what(flying, path, headers, status):
    with pytest.raises(urllib.error.HTTPError) as caught:
        urllib.request.urlopen(urllib.request.Request(flying.board.url + path, headers=headers), timeout=30)
    assert caught.value.code == status
    caught.value.close()


def test_monitoring_reads_health_and_figures(flying):
    with urllib.request.urlopen(f"{flying.board.url}/healthz", timeout=30) as health:
        assert json.load(health)["status"] in set(map(str, Status))
    before = len(flying.sent)
    with urllib.request.urlopen(f"{flying.board.url}/metrics", timeout=30) as figures:
        counts = re.findall(r"^deckline_messages_total\{.*\} (\S+)$", figures.read().decode(), re.M)
    assert 0 < before - 1 <= sum(map(float, counts)) <= len(flying.sent)  # one may be on its way


def test_a_port_that_is_taken_and_a_wrong_address_are_one_line(flying, tmp_path, capsys):
    cv2.imwrite(str(tmp_path / "a.png"), np.zeros((180, 320, 3), np.uint8))
    for address in (flying.board.url.removeprefix("http://"), "nonsense", "127.0.0.1:99999"):
        assert main(["live", str(tmp_path), "--dashboard", address, "--detector", "ufld"]) == 2
        assert address in capsys.readouterr().err.splitlines()[-1]


def test_a_recording_stays_open_until_ctrl_c(tmp_path, browser):
    for index in range(3):
        cv2.imwrite(str(tmp_path / f"{index}.png"), np.full((180, 320, 3), 90 + index, np.uint8))
    code = "import signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler)\n"
    code += "from deckline.cli.main import main; sys.exit(main(sys.argv[1:]))"
    args = ["run", str(tmp_path), "--out", str(tmp_path / "out"), "--detector", "ufld", "--dehazer", "none"]
    command = [sys.executable, "-c", code, *args, "--dashboard", "127.0.0.1:0"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as running:
        said = []
        while not said or (said[-1] and "stays open" not in said[-1]):
            said.append(running.stderr.readline())
        assert said[-1], said  # it ended, and said why
        url = next(line.split()[1] for line in said if line.startswith("dashboard: "))
        page = browser.new_page()
        page.goto(url)
        holds(page, "/recording [\\d.]+ s/.test(document.querySelector('#age')?.textContent)")
        page.keyboard.press("ArrowLeft")
        wait(page, "#past")
        running.send_signal(signal.SIGINT)
        assert running.wait(30) == 0
    assert (tmp_path / "out" / "report.html").exists()


def snapshot(number, size):
    return Snapshot(number, "x" * size, [], None)


def test_memory_forgets_the_oldest():
    memory = Memory(10_000)
    assert memory.get(0) is None and memory.oldest == -1 and memory.after(-1) == []
    for number in range(9):
        memory.add(snapshot(number, 1000))
    assert memory.oldest == 6 and memory.get(5) is None and memory.get(9) is None
    assert memory.get(7).number == 7 and [kept.number for kept in memory.after(6)] == [7, 8]
    memory.add(snapshot(9, 50_000))
    assert memory.oldest == 9


def test_a_snapshot_has_the_values_of_its_record():
    result = chain(frame(3))
    kept = make_snapshot(7, result, frame_record(result, Approach()), None)
    shown = json.loads(kept.shown)
    assert shown["values"]["lateral_deviation_m"]["value"] == pytest.approx(3.0, abs=0.05)
    assert (shown["number"], shown["picture"], shown["status"]) == (7, 7, str(result.guidance.status))
    np.testing.assert_allclose(shown["lines"]["left"], result.estimate.pixel_lines["left"].ends_px, atol=0.06)
    assert kept.row[:2] == [7, 0.75] and kept.row[2] == pytest.approx(3.0, abs=0.05)
    assert kept.pictures.frame.image_rgb.max() == 0 and result.frame.image_rgb.max() > 0
    stale = json.loads(make_snapshot(8, None, STALE | {"live": {"captured_s": 1.0, "sent_s": 2.0}}, 7).shown)
    assert (stale["picture"], stale["time_s"], stale["lines"]) == (7, 2.0, None)
    assert "go around" in stale["advice"][0]["do"]


@pytest.mark.parametrize(("in_widths", "row"), [(True, [3.0 / 16.0, None, 15.0 / 16.0, None]), (False, None)])
def test_a_snapshot_of_a_pose_of_the_picture_has_its_unit(in_widths, row):
    result = picture_result(in_widths)
    kept = make_snapshot(0, result, frame_record(result, Approach()), None)
    shown = json.loads(kept.shown)
    unit = "widths" if in_widths else "m"
    assert (shown["unit"], shown["pose_source"], kept.row[-1]) == (unit, "picture", unit)
    assert "centre" in shown["lines"]
    flown = make_snapshot(0, chain(frame()), frame_record(chain(frame()), Approach()), None)
    assert kept.row[2:6] == pytest.approx(row or flown.row[2:6], abs=1e-2)


def test_dehazing_leaves_the_size_and_a_refusal_has_its_reason():
    pictures = make_snapshot(0, chain(frame()), frame_record(chain(frame()), Approach()), None).pictures
    whole, deck, _ = dehaze(pictures, DEHAZERS["veil"](), Models())
    assert cv2.imdecode(np.frombuffer(whole, np.uint8), 1).shape == (180, 320, 3)
    assert deck is None or cv2.imdecode(np.frombuffer(deck, np.uint8), 1).shape == (270, 480, 3)

    class Refusing:
        def __call__(self, image_rgb):
            raise ValueError("too dark")

    assert dehaze(pictures, Refusing(), Models()) == (pictures.whole, pictures.deck, "not dehazed: too dark")


def test_every_status_but_ok_and_every_flag_has_its_advice():
    record = {"reason": "no pose", "flags": []}
    assert advise(record | {"status": "ok"}) == []
    for status in set(Status) - {Status.OK}:
        (advice,) = advise(record | {"status": str(status)})
        assert advice["words"] == "no pose" and advice["do"]
    late = [{"name": "left", "reason": "off"}, {"name": "stale", "reason": "1 s old"}]
    assert [advice["words"] for advice in advise(record | {"status": "stale", "flags": late})] == ["1 s old"]
    for reason in CHECK:
        (advice,) = advise({"status": "unverified", "reason": "", "flags": [{"name": str(reason), "reason": "why"}]})
        assert advice == {"words": "why", "do": f"check {CHECK[reason]}"}
