"""`deckline eval report`: the saved figures of evaluations as one page, so that no figure is typed by hand."""

import json
from pathlib import Path
from typing import Any

import tyro

from deckline.atomic import write_atomic
from deckline.evaluation.tables import Table, markdown

INTRODUCTION = """\
# Results

`deckline eval report` writes this page from the JSON files that the evaluations save. Each section names the command
that made it, what it ran on, and the date. Differences of time are only fair within one section."""


def report(folder: tyro.conf.Positional[Path], out: Path = Path("docs/results.md")) -> int:
    """Write one page of results from the JSON files that the evaluations save with --json.

    Every file becomes a section, named after it, with its title, command, machine, date and tables, in the order of the
    names.

    Args:
        folder: of JSON files.
        out: Markdown page to write.
    """
    files = sorted(folder.glob("*.json"))
    if not files:
        raise ValueError(f"{folder}: there is no JSON file; save some with deckline eval ... --json FILE")
    sections = [_section(path) for path in files]
    out.parent.mkdir(parents=True, exist_ok=True)
    write_atomic(out, ("\n\n".join([INTRODUCTION, *sections]) + "\n").encode())
    print(out)
    return 0


def _section(path: Path) -> str:
    """One evaluation.

    Raises:
        ValueError: the file is damaged, or no evaluation saved it.
    """
    try:
        saved: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        tables = [Table(**table) for table in saved["_tables"]]
        made_with = ", ".join(saved["_made_with"].values())
        heading = path.stem.replace("-", " ").replace("_", " ").capitalize()
        parts = [f"## {heading}", f"{_one_line(saved['_title'])}.", f"```\n{saved['_command']}\n```", f"{made_with}."]
        return "\n\n".join([*parts, *map(markdown, tables), *saved["_notes"]])
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise ValueError(f"{path}: not the figures of an evaluation ({error!r}); save them with --json") from None


def _one_line(text: str) -> str:
    return " ".join(text.split())
