"""Fetch the photographs without a runway that scripts/photographs.toml lists, to train with and to judge by.

    python scripts/fetch_photographs.py photographs

Writes photographs/train and photographs/judge, each with labels.json (no lines), and photographs/LICENCES.md. Packages
come from the archive of Ubuntu by exact version, 1.5 GB; needs apt and dpkg-deb. A stopped command resumes.
"""

import argparse
import hashlib
import io
import shutil
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path
from typing import Any

from PIL import Image

from deckline.atomic import write_atomic
from deckline.recording.images import read_image
from deckline_lab.labels import LABELS_FILE, LabelledImage, write_labels
from deckline_sim.progress import progress

LIST = Path(__file__).with_name("photographs.toml")
DOWNLOAD, UNPACK = "/usr/lib/apt/apt-helper", "dpkg-deb"
LONG_SIDE_PX = 2560  # of a picture at most
JPEG_QUALITY = 95
USES = ("train", "judge")


def main() -> int:
    parser = argparse.ArgumentParser(description="Fetch photographs without a runway.")
    parser.add_argument("out", type=Path, help="folder of the pictures")
    out = parser.parse_args().out
    for program in (DOWNLOAD, UNPACK):
        if shutil.which(program) is None:
            parser.error(f"{program} is missing: run this on Debian or Ubuntu")
    packages = tomllib.loads(LIST.read_text(encoding="utf-8"))["package"]
    for use in USES:
        (out / use).mkdir(parents=True, exist_ok=True)
    problems = []
    with progress("packages", len(packages)) as advance:
        for package in packages:
            try:
                fetch_package(package, out)
            except (OSError, ValueError) as error:
                problems.append(f"{package['name']} {package['version']}: {error}")
            advance()
    write_lists(packages, out)
    for problem in problems:
        print(problem, file=sys.stderr)
    return 1 if problems else 0


def fetch_package(package: dict[str, Any], out: Path) -> None:
    """Write the pictures of one package that `out` lacks.

    Raises:
        ValueError: the package cannot be downloaded, or a file in it differs from the list.
    """
    missing = [picture for picture in package["pictures"] if not get_target(picture, out).exists()]
    if not missing:
        return
    with tempfile.TemporaryDirectory() as folder:
        archive, files = Path(folder) / "package.deb", Path(folder) / "files"
        run([DOWNLOAD, "download-file", package["url"], str(archive), f"SHA256:{package['sha256']}"])
        run([UNPACK, "-x", str(archive), str(files)])
        for picture in missing:
            source = files / picture["file"]
            if hashlib.sha256(source.read_bytes()).hexdigest() != picture["sha256"]:
                raise ValueError(f"{picture['file']} is not the file that {LIST.name} lists")
            write_picture(source, get_target(picture, out))


def run(command: list[str]) -> None:
    """Run a program; a ValueError with the first error that it printed when it fails."""
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        lines = [line for line in done.stderr.splitlines() if not line.startswith("W:")] or ["unknown error"]
        raise ValueError(lines[0].removeprefix("E: "))


def get_target(picture: dict[str, Any], out: Path) -> Path:
    """Where a picture goes: named by its own checksum."""
    return out / picture["use"] / f"{picture['kind']}-{picture['sha256'][:12]}.jpg"


def write_picture(source: Path, target: Path) -> None:
    """The upright picture, at most LONG_SIDE_PX long, as JPEG."""
    image = Image.fromarray(read_image(source))
    image.thumbnail((LONG_SIDE_PX, LONG_SIDE_PX), Image.Resampling.LANCZOS)
    data = io.BytesIO()
    image.save(data, "JPEG", quality=JPEG_QUALITY)
    write_atomic(target, data.getvalue())


def write_lists(packages: list[dict[str, Any]], out: Path) -> None:
    """labels.json of the pictures that are there, none with a line, and who made them under which licence."""
    rows = ["| picture | author | licence | package | file |", "|---|---|---|---|---|"]
    there: dict[str, list[str]] = {use: [] for use in USES}
    for package in packages:
        for picture in package["pictures"]:
            target = get_target(picture, out)
            if target.exists():
                there[picture["use"]].append(target.name)
                origin = f"{package['name']} {package['version']} | {picture['file']}"
                rows.append(f"| {target.name} | {picture['author']} | {picture['licence']} | {origin} |")
    for use, names in there.items():
        write_labels(out / use / LABELS_FILE, [LabelledImage(name, None, None) for name in sorted(names)])
        print(f"{out / use}: {len(names)} pictures")
    (out / "LICENCES.md").write_text("\n".join(rows) + "\n", encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
