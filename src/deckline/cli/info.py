"""`deckline info`: what is installed and what the shipped weights were measured to do."""

import platform
from importlib.metadata import PackageNotFoundError, version
from typing import TextIO

from deckline import __version__
from deckline.dehaze import DEHAZERS
from deckline.detect import DETECTORS
from deckline.runtime import shipped_models, shipped_weights

PACKAGES = ("numpy", "scipy", "opencv-python-headless", "onnxruntime", "av", "moderngl", "torch")


def print_info(out: TextIO) -> None:
    """Write versions, providers, methods and checked weights as plain lines."""
    import onnxruntime

    print(f"deckline {__version__}, Python {platform.python_version()}, {platform.platform()}", file=out)
    for package in PACKAGES:
        print(f"  {package:24} {_version(package)}", file=out)
    print(f"inference providers: {', '.join(onnxruntime.get_available_providers())}", file=out)
    print(f"dehazers: {', '.join(DEHAZERS)}", file=out)
    print(f"detectors: {', '.join(DETECTORS)}", file=out)
    print("weights:", file=out)
    for name, model in shipped_models().items():
        path = shipped_weights(name)
        print(f"  {name} ({model.kind}): {path.name}, {path.stat().st_size / 1e6:.2f} MB", file=out)
        print(f"    sha256  {model.sha256} (checked)", file=out)
        print(f"    made by {model.command}", file=out)
        print(f"    on      {model.data}", file=out)
        print(f"    with    seed {model.seed}, {model.steps} steps, {model.hardware}, {model.date}", file=out)
        for figure, value in model.figures.items():
            print(f"    {figure}: {value}", file=out)


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"
