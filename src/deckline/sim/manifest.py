"""manifest.json of a rendered dataset: what made it, and the SHA-256 of every file, to check it by."""

import json
import platform
from collections.abc import Mapping
from contextlib import closing
from importlib.metadata import version
from pathlib import Path
from typing import Any

from deckline.atomic import write_atomic
from deckline.extras import needs_extra
from deckline.processes import map_ordered
from deckline.progress import progress
from deckline.runtime import sha256_of

with needs_extra("sim"):
    from deckline.sim.scene.gl import open_context

MANIFEST = "manifest.json"
FORMAT, VERSION = "deckline-dataset", 1
PACKAGES = ("numpy", "scipy", "opencv-python-headless", "moderngl")
NAMED = 3  # damaged files that an error names
MEND = "remove it and give the command that made it again"


def write_manifest(out: Path, values: Mapping[str, Any], jobs: int = 1) -> None:
    """Write manifest.json of a complete dataset: the given values, versions, counts and hashes; no dates, no paths.

    Args:
        jobs: processes that read files; 0: one for every core.
    """
    files = file_hashes(out, jobs)
    content = {
        "format": FORMAT,
        "version": VERSION,
        **values,
        "versions": versions(),
        "counts": count_files(files),
        "files": files,
    }
    write_atomic(out / MANIFEST, (json.dumps(content, indent=1, allow_nan=False) + "\n").encode())


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


def file_hashes(out: Path, jobs: int = 1) -> dict[str, str]:
    """SHA-256 of every file below `out` but the manifest, by relative path in order."""
    names = sorted(path.relative_to(out).as_posix() for path in out.rglob("*") if path.is_file())
    names = [name for name in names if name != MANIFEST]
    hashes = {}
    paths = [out / name for name in names]
    with progress("hashing", len(names)) as advance, closing(map_ordered(sha256_of, paths, jobs)) as digests:
        for name, digest in zip(names, digests, strict=True):
            hashes[name] = digest
            advance()
    return hashes


def count_files(files: Mapping[str, str]) -> dict[str, dict[str, int]]:
    """Frames and tiles of each split."""
    counts: dict[str, dict[str, int]] = {}
    for name in files:
        split, kind = name.split("/", 1)
        counted = counts.setdefault(split, {"frames": 0, "tiles": 0})
        counted["frames"] += kind.startswith("clear/")
        counted["tiles"] += kind.startswith("tiles/hazy/")
    return counts


def versions() -> dict[str, str]:
    """What the bytes of a rendered file depend on besides the settings."""
    context = open_context()
    renderer = str(context.info["GL_RENDERER"])
    context.release()
    return {"python": platform.python_version(), "opengl": renderer} | {name: version(name) for name in PACKAGES}
