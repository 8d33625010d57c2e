"""runway.toml: what is known of the deck that a recording shows, beside the recording.

It has the tables of a run's configuration that belong to the deck and not to the aircraft: all of [deck] and [survey],
and glideslope_deg and touchdown_m of [approach]. For example

    [deck]
    width_m = 20.0

    [approach]
    touchdown_m = 70.0

A run starts from these values; its --config file and its options override them.
"""

from dataclasses import fields
from pathlib import Path
from typing import Any

from deckline.config import Deck, RunConfig, RunwaySurvey
from deckline.config_file import config_from_table, read_toml, suggest_key
from deckline.recording.source import RecordingError

RUNWAY_FILE = "runway.toml"
KEYS = {  # table -> what of it belongs to the deck
    "deck": tuple(item.name for item in fields(Deck)),
    "approach": ("glideslope_deg", "touchdown_m"),
    "survey": tuple(item.name for item in fields(RunwaySurvey)),
}


def read_runway_file(path: Path) -> tuple[RunConfig, str]:
    """The configuration that runs of a recording start from, and a note that lists what the file states.

    Raises:
        RecordingError: no TOML, an unknown key, or a value of a wrong type or out of its range; names file and key.
    """
    try:
        table = read_toml(path)
        stated = [f"{section}.{key} = {value}" for section, key, value in _list_values(table, path)]
        config = config_from_table(RunConfig, table, RunConfig(), str(path))
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror or error}") from None
    except ValueError as error:
        raise RecordingError(str(error)) from None
    return config, f"{path}: {', '.join(stated) or 'states nothing'}"


def _list_values(table: dict[str, Any], path: Path) -> list[tuple[str, str, Any]]:
    """Table, key and value of all that is stated; a ValueError for what does not belong to a deck."""
    values = []
    for section, content in table.items():
        if section not in KEYS or not isinstance(content, dict):
            raise ValueError(f"{path}: unknown table {section}{suggest_key(section, KEYS)}")
        for key, value in content.items():
            if key not in KEYS[section]:
                raise ValueError(f"{path}: unknown key {section}.{key}{suggest_key(key, KEYS[section])}")
            values.append((section, key, value))
    return values
