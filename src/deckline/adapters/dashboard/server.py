"""A web server in a thread of its own. Flying only leaves its newest answer here; whatever browsers do, it goes on."""

import asyncio
import logging
import socket
import threading
import time
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any
from urllib.parse import quote, urlsplit

import cv2
import uvicorn
from fastapi import FastAPI, HTTPException, Response
from nicegui import ui
from starlette.datastructures import Headers
from starlette.middleware.trustedhost import TrustedHostMiddleware
from starlette.types import ASGIApp, Receive, Scope, Send

from deckline.adapters.dashboard.connections import BACKLOG, BoundedProtocol
from deckline.adapters.dashboard.snapshots import Memory, Snapshot, SnapshotPictures, dehaze, make_snapshot
from deckline.adapters.metrics.flight_metrics import FlightMetrics
from deckline.config import RunConfig
from deckline.dehaze import DEHAZERS, NOT_DEHAZED, Dehazer
from deckline.files import print_line
from deckline.flight import FrameResult
from deckline.live.mailbox import Mailbox
from deckline.report.advice import TO_DO
from deckline.report.instrument import FULL_SCALE_DOTS, GLIDESLOPE_DOT_DEG, LATERAL_DOTS
from deckline.report.records import Record
from deckline.report.status import STATUS_COLOURS
from deckline.track.tracker import NEW_FLIGHT_S
from deckline.types import Status

DEFAULT = "127.0.0.1:8080"
LOOPBACK = ("127.0.0.1", "localhost")
TICK_S = 0.1  # between messages to a browser
STEP_S = 0.05  # between snapshots, at least
HELD_S = 1.0  # an older answer is greyed out, whatever its status
DEHAZED = 8  # dehazed snapshots in memory, for other browsers
WAIT_S = 0.1
END_S = 3.0  # for a thread to end
POLICY = "default-src 'self' 'unsafe-inline' 'unsafe-eval' blob: data:; connect-src 'self'; frame-ancestors 'none'"
STYLE = Path(__file__).with_name("board.css")


class Board(ui.element, component="board.vue"):
    """The whole page."""


class Dashboard:
    """Shows a flight to any number of browsers; `view` gets each answer.

    Args:
        address: HOST:PORT to listen on; port 0: any that is free.
        source: what people call the source.
        config: of the flight.
        is_live: answers have an age.
        record: turns recording on and off; None: frames cannot be recorded.
        is_recording: whether it is on.

    Attributes:
        url: of the page.

    Raises:
        ValueError: a wrong address, or nobody can listen there.
    """

    def __init__(
        self,
        address: str,
        source: str,
        config: RunConfig,
        is_live: bool,
        record: Callable[[bool], None] | None = None,
        is_recording: bool = False,
    ) -> None:
        self._socket = _listen(address)
        host, port = self._socket.getsockname()[:2]
        self.url = f"http://{host}:{port}"
        self._config = config
        self._record = record
        self._is_recording = is_recording
        self._facts: Record = {
            "source": source,
            "live": is_live,
            "held_s": HELD_S,
            "new_flight_s": NEW_FLIGHT_S,
            "stale_advice": TO_DO[Status.STALE],
            "can_record": record is not None,
            "dehazers": [name for name in DEHAZERS if name != NOT_DEHAZED],
            "dehazer": config.models.dehazer if config.models.dehazer in DEHAZERS else NOT_DEHAZED,
            "statuses": {str(status): colours.css for status, colours in STATUS_COLOURS.items()},
            "dots": {"lateral": LATERAL_DOTS, "slope_deg": GLIDESLOPE_DOT_DEG, "full": FULL_SCALE_DOTS},
        }
        self._mail: Mailbox[tuple[FrameResult | None, Record, float]] = Mailbox()
        self._metrics = FlightMetrics() if is_live else None
        self._memory = Memory()
        self._newest: tuple[Snapshot, float | None, float] | None = None  # snapshot, its age, and when that was
        self._stopped = threading.Event()
        self._dehazers: dict[str, Dehazer] = {}
        self._dehazed: OrderedDict[tuple[int, str], tuple[bytes, bytes | None, str]] = OrderedDict()
        self._lock = threading.Lock()  # one picture is dehazed at a time
        app = self._build(host, source)
        serving = uvicorn.Config(
            app, http=BoundedProtocol, backlog=BACKLOG, log_config=None, access_log=False, timeout_graceful_shutdown=1
        )
        self._server = uvicorn.Server(serving)
        serve = lambda: asyncio.run(self._server.serve([self._socket]))  # noqa: E731
        self._threads = [threading.Thread(target=step, daemon=True) for step in (self._remember, serve)]
        for thread in self._threads:
            thread.start()

    def view(self, result: FrameResult | None, record: Record) -> None:
        """Take the newest answer; returns at once."""
        self._mail.put((result, record, time.monotonic()))
        if self._metrics is not None and "live" in record:
            self._metrics.update(record)

    def close(self) -> None:
        self._stopped.set()
        logging.getLogger("nicegui").setLevel(logging.CRITICAL)  # it complains of browsers that are still there
        self._server.should_exit = True
        for thread in self._threads:
            thread.join(END_S)
        self._socket.close()

    def _remember(self) -> None:
        number, pictured = 0, None
        while not self._stopped.is_set():
            if (item := self._mail.take(WAIT_S)) is None or "status" not in item[1]:
                continue
            result, record, at_s = item
            try:
                snapshot = make_snapshot(number, result, record, pictured)
            except (ValueError, cv2.error) as error:  # nothing new is shown, and what is shown grows old
                print_line(f"dashboard: {error}")
                continue
            self._memory.add(snapshot)
            self._newest = snapshot, (record.get("live") or {}).get("age_s"), at_s
            number, pictured = number + 1, number if result is not None else pictured
            self._stopped.wait(STEP_S)

    def _build(self, host: str, source: str) -> FastAPI:
        app = FastAPI(openapi_url=None)
        app.add_middleware(SameOrigin)
        if host in LOOPBACK:
            app.add_middleware(TrustedHostMiddleware, allowed_hosts=[*LOOPBACK])
        app.get("/snapshot/{number}")(self._get_snapshot)
        app.get("/picture/{number}/{part}")(self._get_picture)
        if self._metrics is not None:
            self._metrics.add_routes(app)
        ui.page("/", title=f"{source} – deckline", dark=True)(self._show)
        ui.run_with(
            app, message_history_length=0, tailwind=False, show_welcome_message=False, binding_refresh_interval=None
        )
        return app

    def _show(self) -> None:
        """The page of a browser: it gets what is new a few times a second."""
        ui.query(".nicegui-content").style("padding: 0")
        style = STYLE.read_text(encoding="utf-8")
        ui.add_body_html(f"<style>{style}</style>")
        board, sent = Board(), -1
        board.props["facts"] = self._facts

        def tick() -> None:
            nonlocal sent
            news = self._news(sent)
            sent = news["newest"]
            board.run_method("tick", news)

        board.on("record", lambda event: self._switch(bool(event.args)))
        ui.timer(TICK_S, tick)

    def _switch(self, on: bool) -> None:
        if self._record is None:
            return
        try:
            self._record(on)
            self._is_recording = on
        except (OSError, ValueError) as error:
            ui.notify(str(error), type="negative")

    def _news(self, sent: int) -> Record:
        """What is new for a browser that has everything up to snapshot `sent`."""
        new, newest, now_s = self._memory.after(sent), self._newest, time.monotonic()
        news: Record = {"newest": sent, "oldest": self._memory.oldest, "recording": self._is_recording}
        news |= {"rows": [snapshot.row for snapshot in new], "age_s": None, "silent_s": 0.0}
        if new:
            news |= {"newest": new[-1].number, "snapshot": new[-1].shown}
        if newest is not None:
            silent_s = now_s - newest[2]
            news |= {"silent_s": silent_s, "age_s": None if newest[1] is None else newest[1] + silent_s}
        return news

    def _get_snapshot(self, number: int) -> Response:
        return Response(self._find(number).shown, media_type="application/json")

    def _get_picture(self, number: int, part: str, dehazer: str = NOT_DEHAZED) -> Response:
        """A JPEG; the header `Note` has the reason why a picture is not dehazed. Runs in a thread of its own."""
        pictures = self._find(number).pictures
        if pictures is None or part not in ("whole", "deck"):
            raise HTTPException(404)
        whole, deck, note = pictures.whole, pictures.deck, ""
        if dehazer in self._facts["dehazers"]:
            whole, deck, note = self._dehaze(number, pictures, dehazer)
        data = whole if part == "whole" else deck or b""
        return Response(data, media_type="image/jpeg", headers={"Cache-Control": "no-store", "Note": quote(note)})

    def _dehaze(self, number: int, pictures: SnapshotPictures, name: str) -> tuple[bytes, bytes | None, str]:
        with self._lock:
            key = number, name
            if key not in self._dehazed:
                if name not in self._dehazers:  # on one core: guidance comes first
                    self._dehazers[name] = DEHAZERS[name](replace(self._config.engine, threads=1))
                self._dehazed[key] = dehaze(pictures, self._dehazers[name], self._config.models)
                if len(self._dehazed) > DEHAZED:
                    self._dehazed.popitem(last=False)
            return self._dehazed[key]

    def _find(self, number: int) -> Snapshot:
        snapshot = self._memory.get(number)
        if snapshot is None:
            raise HTTPException(404)
        return snapshot


class SameOrigin:
    """Refuses what pages of other origins ask for, and lets ours load nothing from elsewhere."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        headers = Headers(scope=scope) if scope["type"] in ("http", "websocket") else Headers({})
        origin = headers.get("origin")
        if origin is not None and urlsplit(origin).netloc != headers.get("host"):
            if scope["type"] == "websocket":
                return await send({"type": "websocket.close", "code": 1008})
            return await Response(status_code=403)(scope, receive, send)

        async def send_with_policy(message: Any) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [*message["headers"], (b"content-security-policy", POLICY.encode())]
            await send(message)

        await self._app(scope, receive, send_with_policy)


def _listen(address: str) -> socket.socket:
    """A socket on HOST:PORT, or a ValueError."""
    host, _, port = address.rpartition(":")
    if not host or not port.isdecimal() or int(port) > 65535:
        raise ValueError(f"--dashboard takes HOST:PORT, such as {DEFAULT}, got {address}")
    opened = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    opened.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        opened.bind((host, int(port)))
        opened.listen()
    except OSError as error:
        opened.close()
        hint = f"{error.strerror or error}; choose another --dashboard HOST:PORT"
        raise ValueError(f"--dashboard {address}: cannot listen there: {hint}") from None
    return opened
