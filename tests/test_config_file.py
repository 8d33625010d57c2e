"""Configurations as TOML files: round trip, errors that name the key."""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from deckline.config_file import config_from_table, read_config, to_toml_text


@dataclass(frozen=True)
class Air:
    model: Literal["paper", "physical"] | None = None
    glow: float = 1.0

    def __post_init__(self) -> None:
        if self.glow < 0:
            raise ValueError(f"glow must not be negative, got {self.glow}")


@dataclass(frozen=True)
class Scene:
    air: Air = field(default_factory=Air)
    name: str = "sea"


@dataclass(frozen=True)
class Config:
    frames: int = 3
    range_m: tuple[float, float] | None = None
    sizes: tuple[int, ...] = (1, 2)
    clear: bool = False
    model: Path | None = None
    grade: float | Literal["good", "exact"] = "good"
    scene: Scene = field(default_factory=Scene)
    extra: Air | None = None
    airs: tuple[Air, ...] = ()


@dataclass(frozen=True)
class Required:
    size: int


def read(tmp_path: Path, text: str, base: Config | None = None) -> Config:
    path = tmp_path / "deck.toml"
    path.write_text(text)
    return read_config(Config, path, base)


def test_file_overrides_base_and_leaves_the_rest(tmp_path: Path) -> None:
    base = Config(frames=7, range_m=(1.0, 2.0), scene=Scene(Air("paper", 2.0), "harbour"))
    config = read(tmp_path, 'range_m = "none"\nclear = true\ngrade = 2\nscene.air.glow = 0', base)
    assert config == replace(base, range_m=None, clear=True, grade=2.0, scene=Scene(Air("paper", 0.0), "harbour"))
    assert isinstance(config.scene.air.glow, float)
    assert read(tmp_path, "") == Config()


@given(
    st.builds(
        Config,
        frames=st.integers(-(2**63) + 1, 2**63 - 1),
        range_m=st.none() | st.tuples(st.floats(allow_nan=False), st.floats(allow_nan=False)),
        sizes=st.lists(st.integers(0, 9)).map(tuple),
        clear=st.booleans(),
        model=st.none() | st.just(Path("weights/one.onnx")),
        grade=st.floats(allow_nan=False) | st.sampled_from(["good", "exact"]),
        scene=st.builds(Scene, name=st.text(st.characters(exclude_categories=["Cs"]))),
        extra=st.none() | st.builds(Air, st.sampled_from(["paper", None]), st.floats(0, 9)),
        airs=st.lists(st.builds(Air, glow=st.floats(0, 9)), max_size=2).map(tuple),
    )
)
def test_what_is_written_is_read_back(tmp_path_factory: pytest.TempPathFactory, config: Config) -> None:
    path = tmp_path_factory.mktemp("toml") / "deck.toml"
    path.write_text(to_toml_text(config))
    assert read_config(Config, path, Config(extra=Air(glow=5.0), range_m=(0.0, 1.0))) == config


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("frame = 3", r"deck\.toml.*frame\b.*frames"),
        ("scene.air.glov = 3", r"deck\.toml.*scene\.air\.glov.*glow"),
        ("[scene.xyzzy]", r"scene\.xyzzy.*air, name"),
        ('frames = "3"', r"frames.*int.*'3'"),
        ("frames = 3.0", r"frames.*int.*3\.0"),
        ("frames = true", r"frames.*int.*True"),
        ("clear = 1", r"clear.*bool.*1"),
        ("range_m = [1]", r"range_m.*float, float.*none.*\[1\]"),
        ("range_m = [1, 'a']", r"range_m\[1\].*float.*'a'"),
        ("scene.air.model = 'fog'", r"scene\.air\.model.*'paper', 'physical'.*'fog'"),
        ("scene = 3", r"scene.*table.*3"),
        ("frames = 'none'", r"frames.*'none'"),
        ("airs = [{glow = 'a'}]", r"airs\[0\]\.glow.*'a'"),
        ("scene.air.glow = -1", r"deck\.toml.*scene\.air.*glow.*-1"),
        ("frames = ", r"deck\.toml.*TOML"),
    ],
)
def test_errors_name_file_key_and_value(tmp_path: Path, text: str, named: str) -> None:
    with pytest.raises(ValueError, match=named):
        read(tmp_path, text)


def test_a_key_without_default_is_required() -> None:
    assert config_from_table(Required, {"size": 2}) == Required(2)
    assert config_from_table(Required, {}, Required(3)) == Required(3)
    with pytest.raises(ValueError, match=r"recipe.*size"):
        config_from_table(Required, {}, source="recipe")


def test_a_missing_file_is_an_os_error(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="absent"):
        read_config(Config, tmp_path / "absent.toml")


def test_what_toml_cannot_hold_is_refused() -> None:
    with pytest.raises(ValueError, match="set"):
        to_toml_text(replace(Config(), sizes={1}))  # type: ignore[arg-type]
