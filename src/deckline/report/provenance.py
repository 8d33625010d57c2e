"""What a result was made with: software, settings and models."""

import platform
import shlex
import sys
from collections.abc import Callable
from dataclasses import fields, is_dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from deckline import __version__
from deckline.dehaze import OnnxDehazer
from deckline.detect import OnnxDetector
from deckline.flight import Flight
from deckline.pipeline import FrameResult, Pipeline
from deckline.recording import Stream
from deckline.runtime import sha256_of
from deckline.types import Frame

Settings = dict[str, str]


def settings_of(pipeline: Callable[[Frame], FrameResult]) -> Settings:
    """Everything that decides what the pipeline gives, label -> value: a run is resumed only with the same."""
    if isinstance(pipeline, Flight):
        tracker = pipeline.tracker
        tracking = "off" if tracker is None else ", ".join(_options(tracker.config))
        return settings_of(pipeline.pipeline) | {"track": tracking, "approach": ", ".join(_options(pipeline.guide))}
    settings = {"deckline": __version__}
    if isinstance(pipeline, Pipeline):
        config = pipeline.config
        settings["dehazer"] = _model(config.dehazer, pipeline.dehaze)
        settings["detector"] = _model(config.detector, pipeline.detect)
        settings["localization"] = ", ".join(_options(config.localize))
        if config.runway.ramp_m is not None:
            settings["surveyed runway"] = ", ".join(_options(config.runway))
        settings["looks for lines in"] = f"the {config.detect_in} picture"
        settings["seed"] = str(config.seed)
    return settings


def run_info(source: Stream, frames: int, total: int | None, stopped: bool) -> Settings:
    """Where results come from, label -> value, in the order in which the report shows them."""
    machine = f"{platform.system()} {platform.machine()}"
    count = f"{frames}" if total is None else f"{frames} of {total}"
    return {
        "source": source.name,
        "frames": f"{count}, stopped before the end" if stopped else count,
        "date": datetime.now().astimezone().isoformat(sep=" ", timespec="seconds"),
        "version": f"deckline {__version__}, Python {platform.python_version()}, {machine}",
        "command": shlex.join([Path(sys.argv[0]).name, *sys.argv[1:]]),
        **{f"note {number}": note for number, note in enumerate(source.notes, 1)},
    }


def _model(name: str, stage: object) -> str:
    """A method's name; of a network also its file's SHA-256."""
    if not isinstance(stage, OnnxDehazer | OnnxDetector):
        return name
    path = stage.session.path
    file = "" if name.endswith(".onnx") else f"{path.name}, "
    return f"{name} ({file}SHA-256 {sha256_of(path)})"


def _options(config: Any, prefix: str = "") -> list[str]:
    """`name = value` of every setting, those of nested configurations with dotted names."""
    options = []
    for item in fields(config):
        value = getattr(config, item.name)
        nested = is_dataclass(value)
        options += _options(value, f"{prefix}{item.name}.") if nested else [f"{prefix}{item.name} = {value}"]
    return options
