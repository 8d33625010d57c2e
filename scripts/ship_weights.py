"""Put a trained model into the package: store the ONNX file, write its entry into weights/manifest.toml.

    python scripts/ship_weights.py runs/dehaze/dehaze.onnx --name coarse-t --figures runs/dehaze/figures.json \
        --command "deckline train dehaze ..." --data "..." --hardware "2 CPU cores"
"""

import argparse
import datetime
import json
import shutil
from pathlib import Path

from deckline.runtime import load_session
from deckline.runtime.weights import MANIFEST, WEIGHTS, shipped_models
from deckline_lab.train.export import manifest_entry

TABLE = "[[model]]"
TEXTS = ("name", "command", "data", "hardware")  # of an entry, as they are given


def main() -> None:
    parser = argparse.ArgumentParser(description="Put a trained model into the package.")
    parser.add_argument("model", type=Path, help="the exported file")
    for name in TEXTS:
        parser.add_argument(f"--{name}", required=True, help=f"{name} in the manifest")
    parser.add_argument("--figures", type=Path, required=True, help="JSON of measured figures")
    ship(parser.parse_args(), WEIGHTS)


def ship(arguments: argparse.Namespace, folder: Path) -> None:
    """Copy the file to `name`.onnx and replace or add its entry; the other entries stay as they are."""
    config = load_session(arguments.model).config
    figures = {name: round(value, 4) for name, value in json.loads(arguments.figures.read_text()).items()}
    target = folder / f"{arguments.name}.onnx"
    shutil.copyfile(arguments.model, target)
    keys = {name: getattr(arguments, name) for name in TEXTS} | {"kind": config["kind"], "steps": config["step"]}
    keys |= {"seed": config["recipe"]["seed"], "date": str(datetime.date.today()), "figures": figures}
    manifest = folder / MANIFEST
    head, *blocks = manifest.read_text().split(TABLE)
    kept = [TABLE + block for block in blocks if f'\nname = "{arguments.name}"\n' not in block]
    parts = [head, *kept, manifest_entry(target, **keys)]
    manifest.write_text("\n\n".join(part.strip() for part in parts) + "\n")
    print(f"{target}: {shipped_models(folder)[arguments.name].sha256}")


if __name__ == "__main__":
    main()
