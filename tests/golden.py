"""Stored results: a test compares figures and tables with a JSON file that was checked once.

`UPDATE_GOLDEN=1 pytest tests/lab/evaluation` writes the files anew: read the difference before you commit it.
"""

import json
import math
import os
import re
from collections.abc import Mapping
from dataclasses import asdict, is_dataclass
from pathlib import Path
from typing import Any

import pytest

RELATIVE = 1e-6  # of floats, and of numbers within words
UPDATE = "UPDATE_GOLDEN"  # environment variable
NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")


def check_golden(path: Path, values: Any) -> None:
    """Compare JSON values, dataclasses and mappings with a stored file: exact keys and words, numbers to RELATIVE."""
    found = json.loads(json.dumps(_plain(values), allow_nan=False))
    if os.environ.get(UPDATE):
        path.parent.mkdir(exist_ok=True)
        path.write_text(json.dumps(found, indent=1) + "\n")
    _compare(found, json.loads(path.read_text()), path.stem)


def _plain(value: Any) -> Any:
    if is_dataclass(value) and not isinstance(value, type):
        return _plain(asdict(value))
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return str(value) if isinstance(value, float) and not math.isfinite(value) else value


def _compare(found: Any, stored: Any, where: str) -> None:
    if isinstance(stored, dict):
        assert isinstance(found, dict) and list(found) == list(stored), where
        for key, value in stored.items():
            _compare(found[key], value, f"{where}.{key}")
    elif isinstance(stored, list):
        assert isinstance(found, list) and len(found) == len(stored), where
        for k, value in enumerate(stored):
            _compare(found[k], value, f"{where}.{k}")
    elif isinstance(stored, str):
        assert isinstance(found, str) and NUMBER.sub("#", found) == NUMBER.sub("#", stored), where
        numbers = ([float(word) for word in NUMBER.findall(text)] for text in (found, stored))
        assert next(numbers) == pytest.approx(next(numbers), rel=RELATIVE), where
    elif isinstance(stored, float):
        assert found == pytest.approx(stored, rel=RELATIVE, abs=1e-12), where
    else:
        assert found == stored, where
