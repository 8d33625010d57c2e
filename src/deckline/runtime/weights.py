"""The models shipped inside the package, listed in weights/manifest.toml and checked by SHA-256."""

import hashlib
import tomllib
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

WEIGHTS = Path(__file__).parent.parent / "weights"
MANIFEST = "manifest.toml"


@dataclass(frozen=True)
class ShippedModel:
    """One [[model]] of the manifest: where a file came from and what it reached."""

    name: str
    file: str
    """Beside the manifest."""
    sha256: str
    """Hexadecimal, of the file."""
    kind: str
    """`dehaze` or `detect`."""
    command: str
    """That made it."""
    data: str
    """Command, or preset and seed, of the training recordings."""
    seed: int
    steps: int
    """Of the training."""
    hardware: str
    date: str
    figures: dict[str, Any] = field(default_factory=dict)
    """Measured after training, by name with the set that they were measured on."""
    note: str = ""
    """What the command alone does not say: earlier trainings, names in capitals, settings that no option has."""


def shipped_models(folder: Path = WEIGHTS) -> dict[str, ShippedModel]:
    """Manifest entries by name.

    Raises:
        ValueError: no manifest, not TOML, an entry with missing or unknown keys, or a name given twice.
    """
    path = folder / MANIFEST
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ValueError(f"weights manifest {path} cannot be read: {error.strerror}") from error
    except tomllib.TOMLDecodeError as error:
        raise ValueError(f"weights manifest {path} is not TOML: {error}") from error
    known = {item.name for item in fields(ShippedModel)}
    required = known - {"figures", "note"}
    models: dict[str, ShippedModel] = {}
    for entry in content.get("model", []):
        name, missing, unknown = entry.get("name", "?"), required - entry.keys(), entry.keys() - known
        if missing or unknown:
            keys = f"lacks keys {sorted(missing)} and has unknown keys {sorted(unknown)}"
            raise ValueError(f"{path}: model {name!r} {keys}")
        if name in models:
            raise ValueError(f"{path}: model {name!r} is listed twice")
        models[name] = ShippedModel(**entry)
    return models


def shipped_weights(name: str, folder: Path = WEIGHTS) -> Path:
    """Path of a shipped model's file, after checking that it is the file that was measured.

    Raises:
        ValueError: a name that is not in the manifest, a missing file, or a file with another SHA-256.
    """
    models = shipped_models(folder)
    if name not in models:
        raise ValueError(f"no shipped weights {name!r}: the manifest has {', '.join(models) or 'none'}")
    path = folder / models[name].file
    if not path.is_file():
        raise ValueError(f"shipped weights {path} are missing")
    found = sha256_of(path)
    if found != models[name].sha256:
        listed = models[name].sha256
        raise ValueError(f"{path} was changed: SHA-256 is {found}, the manifest has {listed}; it is not loaded")
    return path


def sha256_of(path: Path) -> str:
    """Hexadecimal SHA-256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
