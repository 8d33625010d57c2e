"""Print the size of the house: lines, words, flags of each command, and how many modules a reader must follow.

    python scripts/house.py [--root DIR] [--check] [--no-flags]

Standard library only; the flags come from the help texts of the commands, so counting them needs deckline's extras.
"""

import argparse
import ast
import contextlib
import importlib
import io
import os
import re
import sys
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

SOURCE = ("src", "scripts", "benchmarks", "examples")
TESTS = ("tests",)
BESIDE = ("frag", "vert", "glsl", "html", "js", "css")
MARKS = {"source": 27_000, "tests": 19_000, "words": 9_000}
ENTRIES = {
    "run": "deckline.report.run",
    "training view": "deckline_lab.train.views",
    "eval localization": "deckline_lab.evaluation.localization",
}
FLAG = re.compile(r"^\W*(?:-\w,\s*)?(--[a-z][\w.-]*)", re.MULTILINE)  # --on, --no-on stand in one line: one flag
COMMANDS = re.compile(r"^usage: deckline[\w ]* \[-h\] \{([^}]*)\}")  # of a group: its commands


def find_files(root: Path, folders: Iterable[str], kinds: Iterable[str]) -> list[Path]:
    """Files of these kinds below these folders of the repository."""
    return sorted(path for folder in folders for kind in kinds for path in (root / folder).rglob(f"*.{kind}"))


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


def find_modules(root: Path) -> dict[str, Path]:
    """Every module of the package by its name."""
    modules = {}
    for path in (root / "src" / "deckline").rglob("*.py"):
        parts = path.relative_to(root / "src").with_suffix("").parts
        modules[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return modules


def read_imports(path: Path) -> Iterator[str]:
    """Absolute names that a file imports anywhere, those inside functions included."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def import_closure(entry: str, modules: dict[str, Path]) -> set[str]:
    """Modules that are imported when `entry` is and everything in it is called, with their packages."""
    closure: set[str] = set()
    waiting = [entry]
    while waiting:
        name = waiting.pop()
        if name in modules and name not in closure:
            closure.add(name)
            waiting.extend(read_imports(modules[name]))
        if "." in name:
            waiting.append(name.rpartition(".")[0])
    return closure


def read_help(main: Callable[[list[str]], Any], words: list[str]) -> str:
    """What a command prints with --help."""
    text = io.StringIO()
    with contextlib.redirect_stdout(text), contextlib.suppress(SystemExit):
        main([*words, "--help"])
    return text.getvalue()


def count_flags(main: Callable[[list[str]], Any], words: list[str]) -> Iterator[tuple[str, int]]:
    """Each command below these words and its number of flags, --help not counted."""
    text = read_help(main, words)
    if commands := COMMANDS.match(text):
        for name in commands[1].split(","):
            yield from count_flags(main, [*words, name])
    else:
        yield " ".join(words), len(set(FLAG.findall(text)) - {"--help"})


def print_size(root: Path) -> list[str]:
    """Print the counts; returns one line for each above its mark."""
    source, tests = find_files(root, SOURCE, ["py"]), find_files(root, TESTS, ["py"])
    beside = find_files(root, SOURCE, BESIDE)
    counts = {"source": count_lines(source), "tests": count_lines(tests), "words": count_words(root)}
    print(f"{'Python in src, scripts, benchmarks, examples':46}{counts['source']:8,} lines {len(source):6} files")
    print(f"{'Python in tests':46}{counts['tests']:8,} lines {len(tests):6} files")
    print(f"{'shaders and templates':46}{count_lines(beside):8,} lines {len(beside):6} files")
    print(f"{'README and docs':46}{counts['words']:8,} words")
    return [f"{name}: {counts[name]:,} > {mark:,}" for name, mark in MARKS.items() if counts[name] > mark]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--root", type=Path, default=Path(__file__).parent.parent, help="the repository")
    parser.add_argument("--check", action="store_true", help="exit with 1 when a mark is missed")
    parser.add_argument("--no-flags", action="store_true", help="leave the commands' flags out")
    parser.add_argument("--cli", default="deckline.cli.main", help="module whose `main` is the command")
    for name, module in ENTRIES.items():
        parser.add_argument(f"--{name.replace(' ', '-')}", default=module, help=f"entry module of: {name}")
    given = vars(parser.parse_args())
    root: Path = given["root"]
    missed = print_size(root)
    modules = find_modules(root)
    for name in ENTRIES:
        entry = given[name.replace(" ", "_")]
        if entry not in modules:
            missed.append(f"{name}: no module {entry}")
            continue
        closure = import_closure(entry, modules)
        plain = sum(modules[module].name != "__init__.py" for module in closure)
        lines = count_lines(modules[module] for module in closure)
        print(f"{f'imported by {name}: {plain} modules,':46}{lines:8,} lines {len(closure):6} files")
    if not given["no_flags"]:
        sys.path.insert(0, str(root / "src"))
        os.environ["COLUMNS"] = "100"  # wider help stands in several columns
        for command, count in count_flags(importlib.import_module(given["cli"]).main, []):
            print(f"{f'deckline {command}':46}{count:8} flags")
    for line in missed:
        print(f"missed: {line}", file=sys.stderr)
    return int(bool(missed) and given["check"])


if __name__ == "__main__":
    sys.exit(main())
