"""Bounds of what browsers take: connections, and the time of each request, so that files remain free for the flight."""

import asyncio
from typing import Any

from uvicorn.protocols.http.h11_impl import H11Protocol

CONNECTIONS = 64  # at a time
IDLE_S = 30.0  # for a request and its answer; a page's WebSocket has pings of its own
BACKLOG = 16  # connections accepted in one step of the event loop, before those too many are closed
REFUSAL = b"HTTP/1.1 503 Service Unavailable\r\nconnection: close\r\ncontent-length: 0\r\n\r\n"


class BoundedProtocol(H11Protocol):
    """HTTP that refuses connections beyond `CONNECTIONS`, and closes one without a whole answer for `IDLE_S`."""

    _expiry: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        super().connection_made(transport)
        if len(self.connections) > CONNECTIONS:
            transport.write(REFUSAL)
            transport.close()
        else:
            self._restart_expiry()

    def connection_lost(self, exc: Exception | None) -> None:
        super().connection_lost(exc)
        self._stop_expiry()

    def on_response_complete(self) -> None:
        self._restart_expiry()
        super().on_response_complete()

    def handle_websocket_upgrade(self, event: Any) -> None:
        self._stop_expiry()
        super().handle_websocket_upgrade(event)

    def _restart_expiry(self) -> None:
        self._stop_expiry()
        self._expiry = self.loop.call_later(IDLE_S, self.transport.abort)

    def _stop_expiry(self) -> None:
        if self._expiry is not None:
            self._expiry.cancel()
