"""`deckline info`: what is installed and what the shipped weights were measured to do."""

import os
import platform
from importlib.metadata import PackageNotFoundError, version

from deckline import __version__
from deckline.config import CPU
from deckline.dehaze import DEHAZERS
from deckline.detect import DETECTORS
from deckline.runtime import describe_engines, describe_processor, shipped_models, shipped_weights

PACKAGES = ("numpy", "scipy", "opencv-python-headless", "onnxruntime", "openvino", "av", "moderngl", "torch")


def info() -> int:
    """Print versions, the processor, the engines, and the shipped weights with their measured figures."""
    print(f"deckline {__version__}, Python {platform.python_version()}, {platform.platform()}")
    for package in PACKAGES:
        print(f"  {package:24} {_version(package)}")
    print(f"processor: {describe_processor()}, {os.cpu_count()} cores")
    print(f"engines, by --device; without it {CPU.device} in {CPU.precision}, a thread each core:")
    for device, offer in describe_engines().items():
        print(f"  {device:10} {offer}")
    print(f"dehazers: {', '.join(DEHAZERS)}")
    print(f"detectors: {', '.join(DETECTORS)}")
    print("weights:")
    for name, model in shipped_models().items():
        path = shipped_weights(name)
        print(f"  {name} ({model.kind}): {path.name}, {path.stat().st_size / 1e6:.2f} MB")
        print(f"    sha256  {model.sha256} (checked)")
        print(f"    made by {model.command}")
        if model.note:
            print(f"    note    {model.note}")
        print(f"    on      {model.data}")
        print(f"    with    seed {model.seed}, {model.steps} steps, {model.hardware}, {model.date}")
        for figure, value in model.figures.items():
            print(f"    {figure}: {value}")
    return 0


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"


COMMANDS = {"info": info}
