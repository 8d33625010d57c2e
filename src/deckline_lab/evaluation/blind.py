"""A blind comparison of dehazers by people: sheets of lettered panels, the key to them, and the count of the votes."""

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from string import ascii_uppercase
from typing import Any

import cv2
import numpy as np

from deckline.atomic import write_atomic
from deckline.dehaze import NOT_DEHAZED, Dehazer, restore
from deckline.files import print_line
from deckline.recording import FrameError
from deckline.recording.source import parse_json, read_text
from deckline.recording.text_table import read_table
from deckline.report.draw import BACKGROUND, INK, PANEL, Image, draw_tag, write_picture
from deckline_lab.evaluation.dehazing_pairs import PairSource
from deckline_lab.evaluation.tables import Table
from deckline_lab.statistics import share_interval
from deckline_sim.progress import progress

KEY_FILE, VOTES_FILE, VOTES_FILES, SHEETS_FOLDER = "key.json", "votes.csv", "votes*.csv", "sheets"
SHEET, ORDER = "sheet", "order"  # columns of the form
CONTROL_EVERY = 8  # sheets: one more is added that shows a picture twice
PANEL_PX, GAP_PX, LETTER_PX = 960, 12, 26  # panels are at most so wide
FIRST_NUMBER, LAST_NUMBER = 100_000, 999_999  # of sheets


@dataclass(frozen=True)
class Vote:
    """One sheet as somebody judged it."""

    picture: str
    panels: Mapping[str, str]  # letter -> dehazer, or NOT_DEHAZED
    ranks: Mapping[str, int]  # letter -> place, 0 the best; a letter that was left out has none


def write_blind_sheets(
    out: Path, sources: Sequence[PairSource], dehazers: Mapping[str, Dehazer], panels: int, rng: np.random.Generator
) -> int:
    """Write `out`/sheets/*.png, key.json and the form votes.csv; returns the number of sheets.

    Every `panels` of a picture's input and dehazed ones make a sheet, in a random order under a random number. A
    dehazer that changed nothing has no panel. Every eighth sheet has a control: a sheet that shows one picture twice.

    Args:
        panels: on a sheet, at least 2; where there are fewer, all are on one.
        rng: draws orders and numbers.

    Raises:
        ValueError: `out` holds sheets already, or no dehazer changed a picture.
    """
    check_no_sheets(out)
    (out / SHEETS_FOLDER).mkdir(parents=True, exist_ok=True)
    numbers = map(str, rng.permutation(np.arange(FIRST_NUMBER, LAST_NUMBER + 1)))
    key: dict[str, dict[str, Any]] = {}
    for picture, shown in _restore_all(sources, dehazers):
        for k, names in enumerate(combinations(shown, min(panels, len(shown))), len(key)):
            order = rng.permutation(names).tolist()
            controls = [[*order[:-1], order[0]]] if k % CONTROL_EVERY == 0 else []
            for each, number in zip([order, *controls], numbers, strict=False):
                write_picture(out / SHEETS_FOLDER / f"{number}.png", draw_sheet([shown[name] for name in each]))
                key[number] = {"picture": picture, "panels": dict(zip(ascii_uppercase, each, strict=False))}
    if not key:
        raise ValueError("no sheets: no dehazer changed a picture")
    rows = [f"{SHEET},{ORDER}", *(f"{number}," for number in sorted(key))]
    write_atomic(out / VOTES_FILE, ("\n".join(rows) + "\n").encode())
    write_atomic(out / KEY_FILE, (json.dumps(key, indent=1, sort_keys=True) + "\n").encode())
    return len(key)


def check_no_sheets(out: Path) -> None:
    """Refuse a folder whose sheets somebody may have judged."""
    if (out / KEY_FILE).exists():
        raise ValueError(f"{out} holds sheets already: choose another folder")


def _restore_all(
    sources: Sequence[PairSource], dehazers: Mapping[str, Dehazer]
) -> Iterator[tuple[str, dict[str, Image]]]:
    """Every picture's name, and its input with the dehazed ones that differ from it, by dehazer."""
    with progress("writing sheets", sum(len(source.keys) for source in sources)) as advance:
        for source, key in [(each, key) for each in sources for key in each.keys]:
            advance()
            try:
                frame = source.load(key).frame
            except FrameError as error:
                print_line(f"skipped {error}")
                continue
            shown = {NOT_DEHAZED: frame.image_rgb}
            for name, dehazer in dehazers.items():
                image = restore(dehazer, frame).image_rgb
                if not np.array_equal(image, frame.image_rgb):
                    shown[name] = image
            if len(shown) > 1:
                yield f"{source.name}: {frame.file}", shown


def draw_sheet(images: Sequence[Image]) -> Image:
    """Pictures (H, W, 3) of one size side by side, in rows where there are many, each with its letter."""
    height, width = images[0].shape[:2]
    scale = min(1.0, PANEL_PX / width)
    size = (max(1, round(scale * width)), max(1, round(scale * height)))
    columns = math.ceil(math.sqrt(len(images)))
    rows = math.ceil(len(images) / columns)
    steps = np.array([size[1] + GAP_PX, size[0] + GAP_PX])
    sheet = np.full((*(steps * [rows, columns] + GAP_PX), 3), BACKGROUND, np.uint8)
    for k, image in enumerate(images):
        v, u = (steps * divmod(k, columns) + GAP_PX).tolist()
        sheet[v : v + size[1], u : u + size[0]] = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
        draw_tag(sheet, ascii_uppercase[k], (u + GAP_PX, v + GAP_PX), LETTER_PX, PANEL, INK)
    return sheet


def read_votes(folder: Path) -> tuple[list[Vote], int]:
    """The votes of every votes*.csv in a folder of sheets, and how many sheets were left without one.

    Raises:
        ValueError: no key, no vote, or one that does not fit its sheet.
    """
    try:
        values = parse_json(read_text(folder / KEY_FILE), KEY_FILE)
        key = {number: (str(sheet["picture"]), dict(sheet["panels"])) for number, sheet in values.items()}
    except (OSError, ValueError, LookupError, TypeError, AttributeError) as error:
        raise ValueError(f"{folder / KEY_FILE}: no key to the sheets ({error}): give the folder of --blind") from None
    votes, empty = [], 0
    for path in sorted(folder.glob(VOTES_FILES)):
        for _, row in read_table(path, ",", (SHEET, ORDER))[0]:
            number, order = row[SHEET], row.get(ORDER, "")
            if number not in key:
                raise ValueError(f"{path}: there is no sheet {number!r} in {KEY_FILE}")
            if not order.strip():
                empty += 1
                continue
            picture, panels = key[number]
            votes.append(Vote(picture, panels, parse_order(order, panels, f"{path}: sheet {number}")))
    if not votes:
        raise ValueError(f"{folder}: no votes: write orders such as A>B into {VOTES_FILE}")
    return votes, empty


def parse_order(text: str, letters: Mapping[str, str], where: str) -> dict[str, int]:
    """Place of each letter in an order such as B>A=C, 0 the best.

    Raises:
        ValueError: a letter that is none of `letters`, or one twice; begins with `where`.
    """
    groups = [group.split("=") for group in "".join(text.split()).upper().split(">")]
    named = [letter for group in groups for letter in group]
    for letter in named:
        if letter not in letters or named.count(letter) > 1:
            raise ValueError(f"{where}: expected an order of {', '.join(letters)} such as A>B or A=B, got {text!r}")
    return {letter: place for place, group in enumerate(groups) for letter in group}


def count_votes(votes: Sequence[Vote]) -> dict[str, Any]:
    """Counts of the votes.

    Returns:
        pairs: of every two dehazers that a vote compares, the input as second one: first, second, first_preferred,
            same, second_preferred.
        worse_than_input: by dehazer the pictures that somebody ranked below the input.
        controls, told_apart: how often one picture was shown twice, and taken for two of different quality.
    """
    pairs: dict[tuple[str, str], list[int]] = {}
    worse: dict[str, set[str]] = {}
    controls, told_apart = 0, 0
    for vote in votes:
        by_name = sorted(vote.panels, key=lambda letter: (vote.panels[letter] == NOT_DEHAZED, vote.panels[letter]))
        for first, second in combinations(by_name, 2):
            if not {first, second} & vote.ranks.keys():
                continue
            places = [vote.ranks.get(letter, len(vote.panels)) for letter in (first, second)]
            names = (vote.panels[first], vote.panels[second])
            if names[0] == names[1]:
                controls += 1
                told_apart += places[0] != places[1]
                continue
            outcome = int(np.sign(places[0] - places[1])) + 1
            pairs.setdefault(names, [0, 0, 0])[outcome] += 1
            if names[1] == NOT_DEHAZED and outcome == 2:
                worse.setdefault(names[0], set()).add(vote.picture)
    columns = ("first", "second", "first_preferred", "same", "second_preferred")
    return {
        "pairs": [dict(zip(columns, (*names, *pairs[names]), strict=True)) for names in sorted(pairs)],
        "worse_than_input": {name: sorted(pictures) for name, pictures in sorted(worse.items())},
        "controls": controls,
        "told_apart": told_apart,
    }


def vote_tables(counts: Mapping[str, Any]) -> list[Table]:
    """Each dehazer against the input, and each two against each other."""
    against: list[tuple[str, ...]] = []
    pairwise: list[tuple[str, ...]] = []
    for pair in counts["pairs"]:
        outcomes = [pair[name] for name in ("first_preferred", "same", "second_preferred")]
        low, high = share_interval(outcomes[2], sum(outcomes))
        cells = (*map(str, (sum(outcomes), *outcomes)), f"{outcomes[2] / sum(outcomes):.0%} [{low:.0%}, {high:.0%}]")
        if pair["second"] == NOT_DEHAZED:
            against.append((pair["first"], *cells))
        else:
            pairwise.append((pair["first"], pair["second"], *cells))
    controls = f"Control pairs told apart: {counts['told_apart']} of {counts['controls']}."
    outcome = ("no difference", "worse than the input", "worse, %")
    tables = [Table("Against the input", ("dehazer", "votes", "preferred to it", *outcome), against, (controls,))]
    if pairwise:
        outcome = ("no difference", "second preferred", "second, %")
        columns = ("first", "second", "votes", "first preferred", *outcome)
        tables.append(Table("Against each other", columns, pairwise))
    return tables
