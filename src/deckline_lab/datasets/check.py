"""Compares a rendered dataset with its manifest."""

import json
from pathlib import Path

from deckline_lab.datasets.paper import FORMAT, MANIFEST, VERSION, file_hashes

NAMED = 3  # damaged files that an error names
MEND = "remove it and give the command that made it again"


def check_dataset(out: Path, jobs: int = 1) -> int:
    """Compare every file with the manifest; returns their number.

    Raises:
        ValueError: no manifest or a damaged one, or files that are missing, changed or not in it; names the first few.
    """
    try:
        manifest = json.loads((out / MANIFEST).read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise ValueError(f"{out} holds no {MANIFEST}: give the command that made it again to finish it") from None
    except ValueError as error:  # neither JSON nor text
        raise ValueError(f"{out / MANIFEST} is damaged: {error}; {MEND}") from None
    if not isinstance(manifest, dict) or (manifest.get("format"), manifest.get("version")) != (FORMAT, VERSION):
        raise ValueError(f"{out / MANIFEST}: not a {FORMAT} manifest of version {VERSION}")
    if not isinstance(manifest.get("files"), dict):
        raise ValueError(f"{out / MANIFEST} is damaged: it lists no files; {MEND}")
    expected, found = manifest["files"], file_hashes(out, jobs)
    wrong = [f"{name} is missing" for name in expected if name not in found]
    wrong += [f"{name} has changed" for name, digest in found.items() if expected.get(name, digest) != digest]
    wrong += [f"{name} is not in the manifest" for name in found if name not in expected]
    if wrong:
        more = f" and {len(wrong) - NAMED} more" if len(wrong) > NAMED else ""
        raise ValueError(f"{out}: {', '.join(wrong[:NAMED])}{more}; make the dataset again in another folder")
    return len(expected)
