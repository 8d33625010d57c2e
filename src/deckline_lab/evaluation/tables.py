"""The tables of every evaluation: on the terminal, in files, and on the page of `deckline eval report`."""

import json
import math
import os
import platform
import shlex
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import date
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any

import tyro
from rich import table as rich_table
from rich.console import Console
from rich.markup import escape

from deckline import __version__
from deckline.atomic import write_atomic
from deckline.files import parse_plain, printable, read_regular

FILE_COLUMNS = 190  # of tables that go to a file or a pipe
PACKAGES = ("numpy", "opencv-python-headless", "onnxruntime")  # whose version speed depends on
MISSING = "-"
WRITES = ("--json", "--markdown", "--out")  # options that change no figure

Figures = dict[str, float]
Columns = Mapping[str, tuple[str, float, str]]  # heading: figure, factor, format
INTRODUCTION = """\
# Results

`deckline eval report` writes this page from the JSON files that the evaluations save. Each section names the command
that made it. Differences of time are only fair within one section."""


@dataclass(frozen=True)
class OutputFiles:
    """Where results go besides the terminal.

    Args:
        json: write the figures here as well.
        markdown: write the tables here as well.
    """

    json: Path | None = None
    markdown: Path | None = None


Output = Annotated[OutputFiles, tyro.conf.arg(name="")]
TO_TERMINAL = OutputFiles()


@dataclass(frozen=True)
class Table:
    """One table of words."""

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    notes: Sequence[str] = ()  # below it


@dataclass(frozen=True)
class Saved:
    """What `publish` wrote as JSON, without the figures."""

    title: str
    command: str
    made_with: Mapping[str, str]
    tables: Sequence[Table]
    notes: Sequence[str]


def number(value: float | None, form: str) -> str:
    """A number in a table; a dash where there is none."""
    return MISSING if value is None or not math.isfinite(value) else format(value, form)


def cells(figures: Mapping[str, float], columns: Columns) -> list[str]:
    """The figures under the headings of columns."""
    return [number(factor * figures.get(name, math.nan), form) for name, factor, form in columns.values()]


def figures_table(title: str, figures: Figures) -> Table:
    """A row a figure."""
    return Table(title, ("figure", "value"), [(name, f"{value:.4g}") for name, value in figures.items()])


def made_with() -> dict[str, str]:
    """Software, machine and date of a result."""
    return {
        "deckline": f"deckline {__version__}",
        "machine": f"{platform.machine()} with {os.cpu_count()} cores",
        "python": f"Python {platform.python_version()}",
        **{name: f"{name} {version(name)}" for name in PACKAGES},
        "date": str(date.today()),
    }


def publish(
    title: str,
    tables: Sequence[Table],
    figures: Mapping[str, Any],
    output: OutputFiles = TO_TERMINAL,
    notes: Sequence[str] = (),
) -> None:
    """Print tables under a title, notes below them; write them where files are asked for.

    Args:
        title: what was measured, with which settings.
        tables: in order.
        figures: JSON values; numbers that are not finite are written as null.
        output: its JSON file gets the figures and, under names with an underscore, the command, what it ran on and the
            tables; its Markdown file gets the tables.
        notes: below the last table.
    """
    made = made_with()
    for path in (output.json, output.markdown):
        if path is not None:
            path.parent.mkdir(parents=True, exist_ok=True)
    print_tables(title, made, tables, notes)
    if output.markdown is not None:
        parts = [f"{title}\n{', '.join(made.values())}", *map(markdown, tables), *notes]
        write_atomic(output.markdown, ("\n\n".join(parts) + "\n").encode())
        print(printable(output.markdown))
    if output.json is not None:
        write_json(output.json, title, tables, figures, notes)
        print(printable(output.json))


def write_json(
    path: Path, title: str, tables: Sequence[Table], figures: Mapping[str, Any], notes: Sequence[str] = ()
) -> None:
    """Write figures and, under names with an underscore, the command, what it ran on and the tables; see `publish`."""
    about = {
        "_title": title,
        "_command": _repeatable_command(sys.argv[1:]),
        "_made_with": made_with(),
        "_notes": list(notes),
    }
    content = {**figures, **about, "_tables": [asdict(table) for table in tables]}
    write_atomic(path, (json.dumps(_plain(content), indent=1, allow_nan=False) + "\n").encode())


def print_tables(title: str, made: Mapping[str, str], tables: Sequence[Table], notes: Sequence[str]) -> None:
    """Print a title, what it was made with, tables with their notes, and notes."""
    console = Console(width=None if sys.stdout.isatty() else FILE_COLUMNS)
    console.print(title, style="bold", markup=False)
    console.print(", ".join(made.values()), highlight=False, markup=False)
    for table in tables:
        console.print(_rich(table))
        for note in table.notes:
            console.print(note, highlight=False, markup=False)
    for note in notes:
        console.print(note, highlight=False, markup=False)


def markdown(table: Table, gap: str = " ") -> str:
    """A table under its title in bold, its notes below it; `gap` is written on both sides of every bar."""
    rule = ("---", *("---:" for _ in table.columns[1:]))
    rows = "\n".join(f"|{gap}{f'{gap}|{gap}'.join(row)}{gap}|" for row in (table.columns, rule, *table.rows))
    return "\n\n".join([f"**{table.title}**", rows, *table.notes])


def _rich(table: Table) -> rich_table.Table:
    """The table for a terminal, with a rule where the first column changes after repeating itself."""
    drawn = rich_table.Table(title=escape(table.title), title_justify="left", title_style="bold")
    for k, column in enumerate(table.columns):
        drawn.add_column(escape(column), justify="left" if k == 0 else "right", no_wrap=k == 0)
    first = [row[0] for row in table.rows]
    grouped = len(set(first)) < len(first)
    for k, row in enumerate(table.rows):
        last_of_group = grouped and k + 1 < len(first) and first[k + 1] != first[k]
        drawn.add_row(*map(escape, row), end_section=last_of_group)
    return drawn


def _repeatable_command(args: Sequence[str]) -> str:
    """The command without the files that it wrote."""
    figures_args = [arg for before, arg in zip(("", *args), args, strict=False) if not {before, arg} & {*WRITES}]
    return shlex.join(["deckline", *figures_args])


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def report(folder: tyro.conf.Positional[Path], out: Path = Path("docs/results.md"), tables: int | None = None) -> int:
    """Write one page of results from the JSON files that the evaluations save with --json.

    Every file becomes a section, named after it, with its title, command, machine, date and tables, in the order of the
    names.

    Args:
        folder: of JSON files.
        out: Markdown page to write.
        tables: the first ones of each file, without the notes below them; all with their notes when not given.
    """
    if tables is not None and tables < 1:
        raise ValueError(f"tables must be at least 1, got {tables}")
    files = sorted(folder.glob("*.json"))
    if not files:
        raise ValueError(f"{folder}: there is no JSON file; save some with deckline eval ... --json FILE")
    made, sections = zip(*(_section(path, tables) for path in files), strict=True)
    if len(set(made)) == 1:
        made_with = f"All of it is made with {made[0]}."
    else:
        made_with = "\n".join(f"- {path.stem}: {each}" for path, each in zip(files, made, strict=True))
    out.parent.mkdir(parents=True, exist_ok=True)
    write_atomic(out, ("\n\n".join([INTRODUCTION, made_with, *sections]) + "\n").encode())
    print(out)
    return 0


def read_saved(path: Path) -> Saved:
    """What an evaluation saved with --json.

    Raises:
        ValueError: another file.
    """
    try:
        saved: dict[str, Any] = parse_plain(json.loads, read_regular(path).decode())
        tables = [Table(**table) for table in saved["_tables"]]
        title = " ".join(saved["_title"].split())
        return Saved(title, saved["_command"], dict(saved["_made_with"]), tables, saved["_notes"])
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise ValueError(f"{path}: not the figures of an evaluation ({error!r}); save them with --json") from None


def _section(path: Path, count: int | None) -> tuple[str, str]:
    """What an evaluation was made with, and its section."""
    saved = read_saved(path)
    heading = path.stem.replace("-", " ").replace("_", " ").capitalize()
    parts = [f"## {heading}", f"{saved.title}.", f"```\n{saved.command}\n```"]
    parts += [markdown(table, gap="") for table in saved.tables[:count]]
    return ", ".join(saved.made_with.values()), "\n\n".join([*parts, *(saved.notes if count is None else [])])
