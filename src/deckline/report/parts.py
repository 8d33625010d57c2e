"""Pieces of HTML that the report is made of. Every text from outside is escaped here."""

from collections.abc import Iterable, Mapping
from html import escape

MEANING = {"ok": "both lines", "fine": "depth camera", "coarse": "deck plane", "none": "no distance"}
LISTED = 40  # rows of a list at most


def card(label: str, figure: str, detail: str) -> str:
    """A figure with what it is above and what else to know below."""
    lines = (("label", label), ("figure", figure), ("detail", detail))
    return f'<div class="card">{"".join(f"<p class={name}>{escape(text)}</p>" for name, text in lines)}</div>'


def bar(title: str, parts: list[tuple[str, int]]) -> str:
    """Numbers of frames as shares of a bar, and in words below it."""
    total = sum(frames for _, frames in parts)
    pieces = [(name, frames) for name, frames in parts if frames]
    shares = "".join(f'<i class="{css_class(name)}" style="flex:{frames}"></i>' for name, frames in pieces)
    keys = "".join(
        f'<li class="{css_class(name)}">{name}{f" ({MEANING[name]})" if name in MEANING else ""} '
        f"<b>{frames:,}</b> ({percent(frames / total)})</li>"
        for name, frames in pieces
    )
    none = "" if pieces else '<p class="quiet">no frames</p>'
    return (
        f'<div class="panel"><h3>{title}</h3><div class="bar" aria-hidden="true">{shares}</div>'
        f'<ul class="keys">{keys}</ul>{none}</div>'
    )


def css_class(status: str) -> str:
    """Class of a status in the style sheet."""
    return status.replace(" ", "-")


def listed(head: tuple[str, ...], rows: list[tuple[str, str]], total: int) -> str:
    """A table of texts; of long ones the first rows and how many more there are."""
    shown = rows[:LISTED]
    more = total - len(shown)
    note = f'<p class="quiet">{more} more are not listed here; guidance.csv has all.</p>' if more > 0 else ""
    return f'<div class="panel"><div class="scroll">{table(head, shown, "texts")}</div>{note}</div>'


def info_table(info: Mapping[str, str]) -> str:
    """Label and value, one row each."""
    rows = "".join(
        f'<tr><th scope="row">{escape(label)}</th><td class="text">{escape(value)}</td></tr>'
        for label, value in info.items()
    )
    return f'<table class="info"><tbody>{rows}</tbody></table>'


def table(head: tuple[str, ...], rows: Iterable[tuple[str, ...]], kind: str = "numbers") -> str:
    """A table whose first column names its rows; `kind` is its class in the style sheet."""
    heads = "".join(f'<th scope="col">{escape(name)}</th>' for name in head)
    body = "".join(
        f'<tr><th scope="row">{escape(first)}</th>{"".join(f"<td>{escape(cell)}</td>" for cell in rest)}</tr>'
        for first, *rest in rows
    )
    return f'<table class="{kind}"><thead><tr>{heads}</tr></thead><tbody>{body}</tbody></table>'


def number(value: float | None, unit: str, sign: bool = False) -> str:
    """A figure to three digits with a true minus sign; a dash where there is none."""
    if value is None:
        return "–"
    places = 0 if abs(value) >= 100 else 1 if abs(value) >= 10 else 2
    text = f"{value:{'+' if sign else ''}.{places}f}".replace("-", "−")
    text = text.lstrip("+−") if not float(f"{value:.{places}f}") else text
    return f"{text}{'' if unit == '°' else ' '}{unit}"


def percent(share: float) -> str:
    """A share 0..1 as text."""
    return f"{100 * share:.1f} %" if 0 < share < 1 else f"{100 * share:.0f} %"
