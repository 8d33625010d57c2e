"""What a result was made with: software, settings and models."""

import platform
import re
import shlex
import sys
from datetime import datetime
from pathlib import Path
from typing import Protocol

from deckline import __version__
from deckline.config import RunConfig
from deckline.config_file import to_toml_text
from deckline.dehaze import Dehazer, OnnxDehazer
from deckline.detect import OnnxDetector
from deckline.files import printable
from deckline.flight import Flight, FrameResult
from deckline.recording import Source
from deckline.runtime import sha256_of
from deckline.types import Frame

CREDENTIALS = r"//[^/\s]*@"  # of an address

Settings = dict[str, str]


class Chain(Protocol):
    """What answers frames, as a `Flight` does."""

    config: RunConfig
    dehazer: Dehazer

    def __call__(self, frame: Frame) -> FrameResult: ...


def settings_of(chain: Chain) -> Settings:
    """Everything that decides what a flight answers, label -> value: a run is resumed only with the same."""
    settings = {"deckline": __version__}
    if isinstance(chain, Flight):
        settings["dehazer"] = _model(chain.config.models.dehazer, chain.dehazer)
        settings["detector"] = _model(chain.config.models.detector, chain.detector)
        settings["configuration"] = to_toml_text(chain.config)
    return settings


def run_info(source: Source, frames: int, total: int | None, stopped: bool) -> Settings:
    """Where results come from, label -> value, in the order in which the report shows them."""
    machine = f"{platform.system()} {platform.machine()}"
    count = f"{frames}" if total is None else f"{frames} of {total}"
    command = shlex.join([Path(sys.argv[0]).name.replace("__main__.py", "deckline"), *sys.argv[1:]])
    info = {
        "source": source.name,
        "frames": f"{count}, stopped before the end" if stopped else count,
        "date": datetime.now().astimezone().isoformat(sep=" ", timespec="seconds"),
        "version": f"deckline {__version__}, Python {platform.python_version()}, {machine}",
        "command": re.sub(CREDENTIALS, "//", command),
        **{f"note {number}": note for number, note in enumerate(source.notes, 1)},
    }
    return {label: printable(value) for label, value in info.items()}


def _model(name: str, stage: object) -> str:
    """A method's name; of a network also its file's SHA-256."""
    if not isinstance(stage, OnnxDehazer | OnnxDetector):
        return name
    path = stage.session.path
    file = "" if name.endswith(".onnx") else f"{path.name}, "
    return f"{name} ({file}SHA-256 {sha256_of(path)})"
