"""`deckline sim --serve`: the simulator for AirSim's clients."""

import ipaddress
from dataclasses import dataclass, replace
from pathlib import Path

from deckline import __version__
from deckline.adapters.airsim import HOST, PORT
from deckline.extras import needs_extra
from deckline.sim.record import repeatable_command, what_decides_a_frame

with needs_extra("sim"):
    from deckline.sim import SimConfig

RECORDINGS = Path("recordings")


@dataclass(frozen=True)
class ServeConfig:
    """The server.

    Args:
        host: address to listen on. Other machines reach all but loopback addresses, and there is no password.
        port: TCP port; 0 takes a free one.
        settings: AirSim's settings.json: vehicle, cameras and their picture sizes, recording.

    Raises:
        ValueError: a port that there is not.
    """

    host: str = HOST
    port: int = PORT
    settings: Path | None = None

    def __post_init__(self) -> None:
        if not 0 <= self.port <= 65535:
            raise ValueError(f"port must lie between 0 and 65535, got {self.port}")


def serve_sim(config: SimConfig, server: ServeConfig, out: Path | None) -> None:
    """Serve until interrupted; recordings become folders in `out`.

    Raises:
        ValueError: settings that cannot be, or an address that cannot be listened on.
        OSError: no OpenGL on this machine, or no such settings file.
    """
    with needs_extra("sim"):
        from deckline.adapters.airsim.server import ServerConfig, serve, to_stderr
        from deckline.adapters.airsim.settings import Capture, default_settings, read_settings
    config = replace(config, trajectory="approach", keep_clear=False)
    default = Capture(config.width, config.height, config.fov_deg)
    settings = default_settings(default) if server.settings is None else read_settings(server.settings, default)
    if settings.unused:
        to_stderr(f"{server.settings}: without effect here: {', '.join(settings.unused)}")
    if not is_loopback(server.host):
        to_stderr(f"listening on {server.host}: whoever reaches this machine can steer the simulator")
    made = {"generator": f"deckline {__version__}", "command": repeatable_command(), **what_decides_a_frame(config)}
    serve(config, settings, ServerConfig(server.host, server.port, out or RECORDINGS, scene=made))


def is_loopback(host: str) -> bool:
    """Whether an address cannot be reached from other machines."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"
