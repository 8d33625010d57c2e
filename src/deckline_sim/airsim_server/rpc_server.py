"""Serves the simulator to AirSim's clients: sockets on one thread, the renderer on its own, calls in their order."""

import asyncio
import ipaddress
import math
import socket
import time
from collections.abc import AsyncIterator, Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager, closing
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from deckline import __version__
from deckline.adapters.airsim import HOST, PORT
from deckline.adapters.airsim.protocol import REQUEST_LIMIT, RESPONSE, Decoder, ProtocolError, Request, encode
from deckline.checks import check_numbers
from deckline.files import print_line
from deckline_sim.airsim_server.image_requests import Recorder, record_frame
from deckline_sim.airsim_server.rpc_methods import METHODS, call_method, is_flight
from deckline_sim.airsim_server.sensors import SimulatedSensors
from deckline_sim.airsim_server.service import Service
from deckline_sim.airsim_server.settings import AirSimSettings, CaptureSetting, parse_settings, read_settings
from deckline_sim.airsim_server.sim_clock import SimClock
from deckline_sim.airsim_server.world import World
from deckline_sim.config import DRAWN, SimConfig
from deckline_sim.record import frame_settings, repeatable_command

READ_BYTES = 1 << 16
MAX_CONNECTIONS = 64  # times the request limit bounds the memory that clients can take
PATIENCE_S = 60.0  # with a peer that does not take its answer
IDLE_S = 30.0  # without a call, after which a connection gives its place to a new one where there is none left
UNREAD_BYTES = 1 << 29  # of answers that peers have not taken, all together
MOST_FLIGHTS = 8  # flight commands of a connection that are not answered: all but one have been cancelled
RECORDINGS = Path("recordings")


def log_line(line: str) -> None:
    """Print one line on stderr."""
    print_line(f"deckline: {line}")


@dataclass(frozen=True)
class ServeConfig:
    """The server.

    Args:
        host: address to listen on. Other machines reach all but loopback addresses, and there is no password.
        port: TCP port; 0 takes a free one.
        settings: AirSim's settings.json: vehicle, cameras and their picture sizes, recording.
    """

    host: str = HOST
    port: int = PORT
    settings: Path | None = None

    def __post_init__(self) -> None:
        check_numbers(self, "", "port", least=0, most=65535)


class Connections:
    """Answers every client's calls; an error of one client does not affect the others."""

    def __init__(self, service: Service) -> None:
        self._service = service
        self._tasks: dict[asyncio.Task[None], asyncio.StreamWriter] = {}
        self._called_s: dict[asyncio.StreamWriter, float] = {}  # time of each connection's last call
        self._flights: set[asyncio.Task[None]] = set()  # answers to flight commands; a flight outlives its client
        self._refused: dict[asyncio.StreamWriter, str] = {}  # the reason, until a call reports it to the client

    def accept(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Take a connection, unless there are too many."""
        peer, now_s = _peer_of(writer), asyncio.get_running_loop().time()
        if len(self._called_s) >= MAX_CONNECTIONS:
            idlest = min(self._called_s, key=lambda other: self._called_s[other])
            if now_s - self._called_s[idlest] > IDLE_S:
                self._drop(idlest, f"idle for {IDLE_S:g} s while a new connection waits")
        if len(self._called_s) >= MAX_CONNECTIONS:
            self._service.log(f"{peer}: refused, {MAX_CONNECTIONS} connections are open")
            writer.close()
            return
        writer.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        self._called_s[writer] = now_s
        task = asyncio.create_task(self._converse(reader, writer, peer))
        self._tasks[task] = writer
        task.add_done_callback(self._tasks.pop)

    async def close(self) -> None:
        tasks = [*self._tasks, *self._flights]
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    def _drop(self, writer: asyncio.StreamWriter, why: str) -> None:
        self._service.log(f"{_peer_of(writer)}: {why}; connection closed")
        self._called_s.pop(writer, None)
        writer.transport.abort()

    def _make_room(self, size: int) -> None:
        """Drop the connections with most unread bytes until an answer of `size` bytes fits below UNREAD_BYTES."""
        unread = {writer: writer.transport.get_write_buffer_size() for writer in self._called_s}
        for writer in sorted(unread, key=lambda other: unread[other], reverse=True):
            if sum(unread.values()) + size <= UNREAD_BYTES or not unread[writer]:
                return
            self._drop(writer, f"took no answer while {sum(unread.values()) >> 20} MiB waited")
            del unread[writer]

    async def _converse(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, peer: str) -> None:
        decoder = Decoder(REQUEST_LIMIT)
        flights: set[asyncio.Task[None]] = set()
        try:
            while data := await reader.read(READ_BYTES):
                for message in decoder.feed(data):
                    if not isinstance(message, Request):
                        raise ProtocolError("a response arrived, but the server sends no requests")
                    self._called_s[writer] = asyncio.get_running_loop().time()
                    if not is_flight(message.method):
                        await self._handle(message, writer, peer)
                        continue
                    while len(flights) >= MOST_FLIGHTS:
                        await asyncio.wait(flights, return_when=asyncio.FIRST_COMPLETED)
                    flights.add(task := asyncio.create_task(self._fly(message, writer, peer)))
                    task.add_done_callback(flights.discard)
                    await asyncio.sleep(0)  # commands begin in their order
            if decoder.unfinished:
                self._service.log(f"{peer}: left in the middle of a message")
        except ProtocolError as error:
            self._service.log(f"{peer}: {error}; connection closed")
        except TimeoutError:
            self._service.log(f"{peer}: took no answer for {PATIENCE_S:g} s; connection closed")
            writer.transport.abort()
        except OSError as error:
            self._service.log(f"{peer}: lost: {error.strerror or type(error).__name__}")
        finally:
            self._called_s.pop(writer, None)
            self._refused.pop(writer, None)
            writer.close()

    async def _fly(self, request: Request, writer: asyncio.StreamWriter, peer: str) -> None:
        """Answer a flight command when it ends, while the connection's other calls go on."""
        self._called_s[writer] = math.inf  # not idle
        try:
            await self._handle(request, writer, peer)
        except (TimeoutError, OSError):
            writer.transport.abort()  # which ends the connection's own task
        if writer in self._called_s:
            self._called_s[writer] = asyncio.get_running_loop().time()

    async def _handle(self, request: Request, writer: asyncio.StreamWriter, peer: str) -> None:
        """Call and answer. Clients that `join()` a flight command drop its error: their next other call gets it too."""
        flies, result = is_flight(request.method), None
        error = None if flies else self._refused.pop(writer, None)
        if error is None:
            error, result = await self._call(request, peer)
            if error is not None and flies and writer in self._called_s:
                self._refused[writer] = f"an earlier command was refused: {error}"
        if writer.is_closing():
            return
        if request.id is not None:
            answer = encode([RESPONSE, request.id, error, result])
            self._make_room(len(answer))
            writer.write(answer)
            await asyncio.wait_for(writer.drain(), PATIENCE_S)
        await asyncio.sleep(0)  # a peer that sends many calls at once must not hold up the others

    async def _call(self, request: Request, peer: str) -> tuple[str | None, Any]:
        """Error and result."""
        try:
            return None, await call_method(self._service, request.method, request.params)
        except ValueError as error:
            if request.method not in METHODS:
                self._service.log(f"{peer}: {str(error).partition(';')[0]}")
            return str(error), None
        except Exception as error:  # a mistake of ours in one call must not end the others' connections
            self._service.log(f"{peer}: {request.method} failed: {type(error).__name__}: {error}")
            return f"{request.method}: failed in the server", None


def _peer_of(writer: asyncio.StreamWriter) -> str:
    return "{}:{}".format(*writer.get_extra_info("peername", ("?", "?"))[:2])


@asynccontextmanager
async def serving(
    config: SimConfig,
    settings: AirSimSettings,
    host: str = HOST,
    port: int = PORT,
    out: Path = RECORDINGS,
    scene: Mapping[str, Any] | None = None,
    log: Callable[[str], None] = log_line,
    clock: SimClock | None = None,
) -> AsyncIterator[int]:
    """Serve while the context is open; gives the port.

    Args:
        port: 0 takes a free one.
        out: recordings become folders in it.
        scene: free keys of a recording's scene.json.
        log: gets a line for everything unusual.
        clock: the simulated time; None: it begins now.

    Raises:
        RendererError: no OpenGL through EGL on this machine.
        ValueError: the address cannot be listened on.
    """
    loop = asyncio.get_running_loop()
    with ThreadPoolExecutor(1, thread_name_prefix="renderer") as renderer:
        clock = clock or SimClock(lambda: settings.clock_speed * time.monotonic())
        world = await loop.run_in_executor(renderer, World, config, settings, clock)

        render = partial(loop.run_in_executor, renderer)
        recorder = Recorder(out, settings, partial(render, record_frame, world), dict(scene or {}), log)
        service = Service(world, render, recorder, SimulatedSensors(world, config.seed), log)
        connections = Connections(service)
        try:
            try:
                listening = await asyncio.start_server(connections.accept, host, port)
            except OSError as error:
                reason = error.strerror or str(error)
                raise ValueError(f"cannot listen on {host}:{port} ({reason}): choose --host or --port") from None
            with closing(listening):
                yield int(listening.sockets[0].getsockname()[1])
        finally:
            await connections.close()
            await recorder.stop()
            await render(world.close)


async def serve_forever(config: SimConfig, settings: AirSimSettings, options: ServeConfig, out: Path) -> None:
    scene = {"generator": f"deckline {__version__}", "command": repeatable_command(), **frame_settings(config)}
    async with serving(config, settings, options.host, options.port, out, scene) as port:
        log_line(f"AirSim server on {options.host}:{port}, vehicle {settings.vehicle}; Ctrl-C ends it")
        await asyncio.Event().wait()


def serve_sim(config: SimConfig, options: ServeConfig, out: Path | None) -> None:
    """Serve until interrupted; recordings become folders in `out`. Invalid settings are a ValueError or OSError."""
    if config.preset in DRAWN:
        raise ValueError(f"the server flies in a rendered world, which preset {config.preset!r} has not")
    config = replace(config, trajectory="approach", keep_clear=False)
    default = CaptureSetting(config.width, config.height, config.fov_deg)
    settings = parse_settings({}, default) if options.settings is None else read_settings(options.settings, default)
    if settings.unused:
        log_line(f"{options.settings}: without effect here: {', '.join(settings.unused)}")
    if not is_loopback(options.host):
        log_line(f"listening on {options.host}: every machine that reaches this address can steer the simulator")
    asyncio.run(serve_forever(config, settings, options, out or RECORDINGS))


def is_loopback(host: str) -> bool:
    """Whether an address cannot be reached from other machines."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"
