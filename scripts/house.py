"""Print the size of the repository: lines of Python, words of the documentation, modules that commands load.

    python scripts/house.py [--root DIR] [--no-commands]

Each command runs on little data in a process of its own and lists its modules when it ends. That takes about a minute
and needs the extras sim and train; without them, and with --no-commands, there are lines and words alone.
"""

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Iterable
from pathlib import Path

PYTHON = {
    "deckline": ("src/deckline",),
    "deckline_sim": ("src/deckline_sim",),
    "deckline_lab": ("src/deckline_lab",),
    "tests": ("tests",),
    "scripts, benchmarks, examples": ("scripts", "benchmarks", "examples"),
}
SAMPLE = "src/deckline/sample/approach.zip"
VIEWS = "--preset train --trajectory random --visibility clear --depth.range-m inf --frames 4 --width 160 --height 96"
COMMANDS = {  # name: arguments; {data} is an empty folder with the sample in {data}/sample, views in {data}/views
    "run": "run {data}/sample --out {data}/run --max-frames 2",
    "train detect": "train detect {data}/views --out {data}/detect --steps 2 --batch 1 --held-out 0.5 --threads 1",
    "eval integrity --rendered": "eval integrity --rendered --runs 1 --nominal 1 --frames 8 --aid depth --fault glare",
}
PROBE = """
import atexit, json, sys
def write_modules():
    files = {name: getattr(module, "__file__", None) for name, module in sys.modules.items()}
    ours = {name: file for name, file in files.items() if file and name.split(".")[0].startswith("deckline")}
    with open(path, "w") as output:
        json.dump(ours, output)
path = sys.argv.pop(1)
atexit.register(write_modules)
from deckline.cli.main import main
sys.exit(main())
"""


def count_lines(paths: Iterable[Path]) -> int:
    """Lines of all files together, empty ones included."""
    return sum(len(path.read_text(encoding="utf-8").splitlines()) for path in paths)


def count_words(root: Path) -> int:
    """Words of README.md and docs/**/*.md, without the experiments and the pages of the API."""
    pages = [root / "README.md"]
    for page in (root / "docs").rglob("*.md"):
        part = page.relative_to(root / "docs").parts[0]
        if part != "experiments" and not part.startswith("api"):
            pages.append(page)
    return sum(len(page.read_text(encoding="utf-8").split()) for page in pages)


def load_modules(root: Path, arguments: list[str], folder: Path) -> dict[str, Path]:
    """Run a command and return the files of its modules of deckline, deckline_sim and deckline_lab, by name.

    Raises:
        RuntimeError: the command failed; its last line.
    """
    output = folder / "modules.json"
    environment = os.environ | {"PYTHONPATH": str(root / "src")}
    command = [sys.executable, "-c", PROBE, str(output), *arguments]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError((done.stderr.splitlines() or [f"exit code {done.returncode}"])[-1])
    return {name: Path(file) for name, file in json.loads(output.read_text()).items()}


def print_row(name: str, lines: int, files: int, unit: str) -> None:
    print(f"{name:34}{lines:8,} lines {files:5,} {unit}")


def print_commands(root: Path) -> None:
    """Print how many modules each command loads, `__init__.py` not counted, and their lines."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        zipfile.ZipFile(root / SAMPLE).extractall(folder / "sample")
        for command, arguments in {"sim": f"sim --out {{data}}/views {VIEWS}", **COMMANDS}.items():
            words = [word.format(data=folder) for word in arguments.split()]
            try:
                loaded = load_modules(root, words, folder)
            except RuntimeError as error:
                print(f"deckline {command}: {error}", file=sys.stderr)
                continue
            if command in COMMANDS:
                modules = [path for path in loaded.values() if path.name != "__init__.py"]
                print_row(f"deckline {command}", count_lines(modules), len(modules), "modules")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--root", type=Path, default=Path(__file__).resolve().parent.parent, help="the repository")
    parser.add_argument("--no-commands", action="store_true", help="run no command")
    given = parser.parse_args()
    for name, folders in PYTHON.items():
        files = [path for folder in folders for path in (given.root / folder).rglob("*.py")]
        print_row(name, count_lines(files), len(files), "files")
    print(f"{'README and docs':34}{count_words(given.root):8,} words")
    if not given.no_commands:
        print_commands(given.root)
    return 0


if __name__ == "__main__":
    signal.signal(signal.SIGPIPE, signal.SIG_DFL)  # a reader that has read enough, as `head`, is no error
    sys.exit(main())
