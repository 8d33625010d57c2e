"""`deckline sim`: everything behind it needs the sim extra."""

import argparse
import json
import math
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Annotated, Any

import tyro

from deckline.config_file import config_from_table, read_config, to_toml_text
from deckline.recording.writer import ImageFormat
from deckline_sim import CLEAR, SimConfig
from deckline_sim.airsim_server.rpc_server import ServeConfig, serve_sim
from deckline_sim.config import AirModel, DepthConfig, Preset, Sky, TimeOfDay, Trajectory
from deckline_sim.record import ContactSheetConfig, simulate, write_contact_sheet
from deckline_sim.visibility import parse_visibility, visibility_text
from deckline_sim.workers import RayOption, choose_workers

SIM_HELP = """\
examples:
  deckline sim --out approach --frames 40 --visibility 300..3000 --seed 1
  deckline sim --contact-sheet sheet.jpg --jobs 0

Render a recording of a deck: images, depth, poses and exact truth lines, in AirSim's layout. A stopped command
continues its recording when it is given again. With --contact-sheet, one picture of many
frames is rendered instead, of random ships by default. With --serve, AirSim's clients fly in the simulated world.

Wind, gusts, rain, lens, sensor, errors of depth and pose, and the contact sheet's layout are keys of the TOML file of
--config; --print-config shows them all. Flags override --set, and --set overrides the file."""
TABLES = ("weather", "air", "depth")  # whose flags are named TABLE.KEY


@dataclass(frozen=True)
class SimSettings(SimConfig):
    """What the TOML file of `deckline sim` holds: what to simulate, the contact sheet, the server."""

    frames: int = 40
    visibility_m: tuple[float, float] = (300.0, 3000.0)
    sheet: ContactSheetConfig = field(default_factory=ContactSheetConfig)
    server: ServeConfig = field(default_factory=ServeConfig)

    @property
    def simulated(self) -> SimConfig:
        """The simulator's own part."""
        return SimConfig(**{item.name: getattr(self, item.name) for item in fields(SimConfig)})


RECORDING = SimSettings()
SHEET = SimSettings(preset="train", trajectory="random", frames=48, frames_per_ship=1, visibility_m=(500.0, 10000.0))
# As AirSim: clear air until a client asks for fog, and a depth camera that sees to the horizon.
SERVED = SimSettings(visibility_m=CLEAR, depth=DepthConfig(range_m=math.inf))


@dataclass(frozen=True, kw_only=True)
class SimFlags:
    """The flags of `deckline sim`; those without a default are settings."""

    out: Path | None = None  # folder of the recording; with --serve, of the clients' recordings
    contact_sheet: Path | None = None  # write this .png or .jpg of all the frames instead
    serve: bool = False  # answer AirSim's clients until Ctrl-C
    config: Path | None = None  # TOML file of settings
    set: tuple[str, ...] = ()  # settings as the file has them, such as exposure.rain_mm_h=10
    print_config: bool = False  # print all settings as TOML and stop
    jobs: int = 1  # processes that render; 0: one for every core
    ray: RayOption = None  # render as Ray tasks, on the cluster at ADDRESS, without it on one that is started here
    image_format: ImageFormat = "png"  # png; ppm: large, quick to write; jpg: small, with losses
    preset: Preset  # the ship; train: random ships, light, weather, cameras
    trajectory: Trajectory  # one approach, the paper's profile, unrelated views
    frames: int  # how many
    visibility: str  # metres at 2 % contrast: one value, LOW..HIGH or clear
    seed: int  # the same seed makes the same files
    width: int  # of the image, px
    height: int  # of the image, px
    fov_deg: float  # horizontal field of view
    keep_clear: bool  # also write every view without its haze
    range_m: tuple[float, float] | None  # nearest and farthest random view from the ramp
    start_m: float  # distance to the ramp where an approach begins
    end_m: float  # where it ends
    frames_per_ship: int  # random views that share a ship
    # None: day; train draws it
    weather_time_of_day: Annotated[TimeOfDay | None, tyro.conf.arg(name="weather.time-of-day")]
    weather_sky: Annotated[Sky | None, tyro.conf.arg(name="weather.sky")]  # None: not overcast; train draws it
    # 0 to 6, of sea and ship. None: drawn
    weather_sea_state: Annotated[int | None, tyro.conf.arg(name="weather.sea-state")]
    # haze on 8-bit levels as in the paper, or on light
    air_model: Annotated[AirModel | None, tyro.conf.arg(name="air.model")]
    # reach of the depth camera; inf: to the horizon
    depth_range_m: Annotated[float, tyro.conf.arg(name="depth.range-m")]
    host: str  # address that the server listens on
    port: int  # of the server
    settings: Path | None  # AirSim's settings.json for the server


def sim(args: Sequence[str]) -> int:
    """Parse and run `deckline sim ARGS`."""
    base = _read_settings(args)
    default = SimFlags(**_setting_flags(base))
    flags = tyro.cli(SimFlags, prog="deckline sim", description=SIM_HELP, args=args, default=default)
    settings = _apply_flags(base, flags)
    if flags.print_config:
        print(to_toml_text(settings), end="")
        return 0
    if flags.serve and flags.contact_sheet is not None:
        raise ValueError("deckline sim takes --serve or --contact-sheet, not both")
    if flags.serve:
        serve_sim(settings.simulated, settings.server, flags.out)
    elif (flags.out is None) == (flags.contact_sheet is None):
        raise ValueError(
            "deckline sim needs --out FOLDER for a recording, --contact-sheet FILE for a picture, or --serve"
        )
    elif flags.out is not None:
        simulate(settings.simulated, flags.out, flags.image_format, choose_workers(flags.ray, flags.jobs))
    elif flags.contact_sheet is not None:
        write_contact_sheet(
            settings.simulated, flags.contact_sheet, settings.sheet, choose_workers(flags.ray, flags.jobs)
        )
    return 0


def _read_settings(args: Sequence[str]) -> SimSettings:
    """The settings below the flags: defaults of a recording, a contact sheet or a server, then the file, then --set."""
    parser = argparse.ArgumentParser(prog="deckline sim", add_help=False, allow_abbrev=False)
    parser.add_argument("--config", type=Path)
    parser.add_argument("--set", nargs="*", default=[])
    parser.add_argument("--serve", action="store_true")
    parser.add_argument("--contact-sheet", "--contact_sheet")
    known, _ = parser.parse_known_args(list(args))
    settings = SHEET if known.contact_sheet else SERVED if known.serve else RECORDING
    if known.config is not None:
        settings = read_config(SimSettings, known.config, settings)
    for assignment in known.set:
        settings = config_from_table(SimSettings, _parse_assignment(assignment), settings, "--set")
    return settings


def _parse_assignment(text: str) -> dict[str, Any]:
    """KEY=VALUE as TOML; a bare word is a string."""
    key, equals, value = text.partition("=")
    if not equals:
        raise ValueError(f"--set takes KEY=VALUE, got {text!r}")
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        return tomllib.loads(f"{key}={json.dumps(value)}")


def _setting_flags(settings: SimSettings) -> dict[str, Any]:
    """The flags whose values are in the settings."""
    values: dict[str, Any] = {"visibility": visibility_text(settings.visibility_m)}
    for item in fields(SimFlags):
        table, key = _setting_of(settings, item.name)
        holder = getattr(settings, table) if table else settings
        if hasattr(holder, key):
            values[item.name] = getattr(holder, key)
    return values


def _setting_of(settings: SimSettings, flag: str) -> tuple[str, str]:
    """Table and key of the setting that a flag changes; a top-level key has the table ""."""
    table, _, key = flag.partition("_")
    return (table, key) if table in TABLES else ("server" if hasattr(settings.server, flag) else "", flag)


def _apply_flags(settings: SimSettings, flags: SimFlags) -> SimSettings:
    tables: dict[str, dict[str, Any]] = {"": {"visibility_m": parse_visibility(flags.visibility)}}
    for name in set(_setting_flags(settings)) - {"visibility"}:
        table, key = _setting_of(settings, name)
        tables.setdefault(table, {})[key] = getattr(flags, name)
    values = tables.pop("")
    values |= {table: replace(getattr(settings, table), **changes) for table, changes in tables.items()}
    return replace(settings, **values)


COMMANDS = {"sim": sim}
PARSED_BY_COMMAND = True
