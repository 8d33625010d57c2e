"""Files of labelled pictures, and what an error about them lacks."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest


@pytest.fixture
def lay(tmp_path: Path) -> Callable[[dict[str, Any]], Path]:
    """Write files below a folder by their names: a text, JSON values, or for None a picture of 100x50 px."""

    def write(files: dict[str, Any]) -> Path:
        for name, content in files.items():
            path = tmp_path / name
            path.parent.mkdir(parents=True, exist_ok=True)
            if content is None:
                cv2.imwrite(str(path), np.zeros((50, 100, 3), np.uint8))
            else:
                path.write_text(content if isinstance(content, str) else json.dumps(content))
        return tmp_path

    return write


@pytest.fixture
def missing_words() -> Callable[..., list[str]]:
    """The words that the one-line ValueError of a call lacks."""

    def check(words: list[str], function: Callable[..., Any], *args: Any) -> list[str]:
        with pytest.raises(ValueError) as caught:
            function(*args)
        text = str(caught.value)
        return [word for word in words if word not in text] + (["one line"] if "\n" in text else [])

    return check
