"""`deckline info`: what is installed and what the shipped weights were measured to do."""

import platform
from importlib.metadata import PackageNotFoundError, version

from deckline import __version__
from deckline.dehaze import DEHAZERS
from deckline.detect import DETECTORS
from deckline.runtime import shipped_models, shipped_weights

PACKAGES = ("numpy", "scipy", "opencv-python-headless", "onnxruntime", "av", "moderngl", "torch")


def info() -> int:
    """Print versions, inference providers and the shipped weights with their measured figures."""
    import onnxruntime

    print(f"deckline {__version__}, Python {platform.python_version()}, {platform.platform()}")
    for package in PACKAGES:
        print(f"  {package:24} {_version(package)}")
    print(f"inference providers: {', '.join(onnxruntime.get_available_providers())}")
    print(f"dehazers: {', '.join(DEHAZERS)}")
    print(f"detectors: {', '.join(DETECTORS)}")
    print("weights:")
    for name, model in shipped_models().items():
        path = shipped_weights(name)
        print(f"  {name} ({model.kind}): {path.name}, {path.stat().st_size / 1e6:.2f} MB")
        print(f"    sha256  {model.sha256} (checked)")
        print(f"    made by {model.command}")
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
