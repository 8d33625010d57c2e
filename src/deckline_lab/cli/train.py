"""`deckline train`: everything behind it needs the train extra."""

from dataclasses import make_dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar, get_args

import tyro

from deckline.config_file import read_config
from deckline.extras import needs_extra
from deckline.runtime import shipped_models, shipped_weights
from deckline_lab.rivals import LAB_WEIGHTS

with needs_extra("train"):
    from deckline_lab.rivals.dehazers import DEHAZERS
    from deckline_lab.rivals.detectors import DETECTORS
    from deckline_lab.train import dehaze as train_dehaze
    from deckline_lab.train import detect as train_detect
    from deckline_lab.train.dehaze import DehazeTrainConfig
    from deckline_lab.train.detect import DetectTrainConfig
    from deckline_lab.train.loop import Recipe

R = TypeVar("R", bound=Recipe)
SHIPPED = "shipped"
SWITCHES = ("cpu_minutes", "prior", "tensorboard")  # not given, they leave the recipe's value
DEHAZE_NETWORKS, DETECT_NETWORKS = train_dehaze.NETWORKS | DEHAZERS, train_detect.NETWORKS | DETECTORS
Device = Literal["auto", "cpu", "cuda"]

# Flags that override the recipe: type and help.
FLAGS: dict[str, tuple[Any, str]] = {
    "minutes": (float, "training time, if that ends before the steps; inf: no limit."),
    "cpu_minutes": (bool, "minutes are of computing: the same budget on a busy machine."),
    "steps": (int, "training steps, if they end before the minutes."),
    "batch": (int, "crops or views a step."),
    "lr": (float, "largest learning rate."),
    "held_out": (float, "share of each recording that is validated on."),
    "seed": (int, "of first weights and of all that is drawn."),
    "threads": (int, "of torch on a CPU; 0: torch's own choice."),
    "device": (Device, "to train on."),
    "bf16": (bool, "half of the arithmetic in bfloat16; None: on CUDA only."),
    "tensorboard": (bool, "write TensorBoard's events as well; needs the extra tensorboard."),
}
DEHAZE_FLAGS: dict[str, tuple[Any, str]] = {
    "network": (Literal[*DEHAZE_NETWORKS], "ours on a grid of 4 px (coarse) or at full resolution, or one to compare."),
    "prior": (bool, "start from the geometry dehazer's picture, as the shipped network does; coarse networks only."),
    "crop_height": (int, "px."),
    "crop_width": (int, "px."),
    "visible_share": (float, "of the loss, on what haze leaves visible."),
}
DETECT_FLAGS: dict[str, tuple[Any, str]] = {"network": (Literal[*DETECT_NETWORKS], "a shipped one, or one to compare.")}


def make_flags(recipe: type[Recipe], flags: dict[str, tuple[Any, str]]) -> Any:
    """A dataclass of flags; those that are not given are None, or False, and the recipe's value stays."""
    items: list[tuple[str, Any, Any]] = []
    for name, (kind, text) in flags.items():
        if name in SWITCHES:
            items.append((name, Annotated[bool, tyro.conf.arg(help=text)], False))
            continue
        choices = get_args(kind) or (("True", "False") if kind is bool else ())
        metavar = "{" + ",".join(choices) + "}" if choices else "N"
        hint = f"(default: {getattr(recipe, name)}, or the recipe's)"
        option = tyro.conf.arg(help=text, metavar=metavar, help_behavior_hint=hint)
        items.append((name, Annotated[kind | None, option], None))
    return make_dataclass("Flags", items, frozen=True)


DehazeFlags = make_flags(DehazeTrainConfig, DEHAZE_FLAGS | FLAGS)
DetectFlags = make_flags(DetectTrainConfig, DETECT_FLAGS | FLAGS)
NO_DEHAZE_FLAGS, NO_DETECT_FLAGS = DehazeFlags(), DetectFlags()


def dehaze(
    recordings: tyro.conf.Positional[tuple[Path, ...]],
    out: Path,
    recipe: Path | None = None,
    start_from: str | None = None,
    photographs: Path | None = None,
    flags: Annotated[DehazeFlags, tyro.conf.arg(name="")] = NO_DEHAZE_FLAGS,  # type: ignore[valid-type]
) -> int:
    """Train a dehazing network on clear recordings with depth, or on pairs of hazy and clear pictures of your own.

    The same command goes on from its own checkpoint in --out, where recipe.toml holds every value that was used.

    Args:
        recordings: folders written by `deckline sim --visibility clear --depth.range-m inf`, and folders of pictures
            whose labels.json names the clear one of each hazy one as pair_of; one given twice is drawn twice as often.
        out: folder of recipe.toml, the checkpoint, losses.csv, losses.png and dehaze.onnx.
        recipe: TOML file of all that training can be told (see recipe.toml in an --out); flags override it.
        start_from: first weights: folder of an earlier training, .onnx file, shipped, or a shipped model's name.
        photographs: folder of clear photographs; they get haze over a made-up depth, for pictures without a pose.
        flags: over the recipe.
    """
    config = make_recipe(DehazeTrainConfig, recipe, flags)
    start = find_weights(start_from, config.network)
    train_dehaze.train_dehaze(config, list(recordings), out, start, DEHAZE_NETWORKS, photographs)
    return 0


def detect(
    recordings: tyro.conf.Positional[tuple[Path, ...]],
    out: Path,
    recipe: Path | None = None,
    start_from: str | None = None,
    photographs: Path | None = None,
    flags: Annotated[DetectFlags, tyro.conf.arg(name="")] = NO_DETECT_FLAGS,  # type: ignore[valid-type]
) -> int:
    """Train a line detector on clear recordings with depth and true lines, or on pictures of your own with labels.json.

    The same command goes on from its own checkpoint in --out, where recipe.toml holds every value that was used. For
    pictures of your own start from shipped weights with a lower --lr, such as 2e-4.

    Args:
        recordings: folders written by `deckline sim --visibility clear --depth.range-m inf`, and folders of pictures
            with labels.json, to which no haze is added; one given twice is drawn twice as often.
        out: folder of recipe.toml, the checkpoint, losses.csv, losses.png and detect.onnx.
        recipe: TOML file of all that training can be told (see recipe.toml in an --out); flags override it.
        start_from: first weights: folder of an earlier training, .onnx file, shipped, or a shipped model's name.
        photographs: folder of pictures without a runway, which take the place of some views' sky.
        flags: over the recipe.
    """
    config = make_recipe(DetectTrainConfig, recipe, flags)
    start = find_weights(start_from, config.network)
    train_detect.train_detect(config, list(recordings), out, start, DETECT_NETWORKS, photographs)
    return 0


def make_recipe(cls: type[R], file: Path | None, flags: Any) -> R:
    """The recipe of a file, or the defaults, with what the flags say."""
    base = cls() if file is None else read_config(cls, file)
    given = {name: value for name, value in vars(flags).items() if value is not None}
    return replace(base, **{name: value for name, value in given.items() if value or name not in SWITCHES})


def find_weights(source: str | None, network: str) -> Path | None:
    """Where first weights lie: `shipped` means those of `network`; else a shipped model's name, a path, or None."""
    if source is None:
        return None
    if source == SHIPPED or source in shipped_models():
        return shipped_weights(network if source == SHIPPED else source)
    return shipped_weights(source, LAB_WEIGHTS) if source in shipped_models(LAB_WEIGHTS) else Path(source)


COMMANDS = {"dehaze": dehaze, "detect": detect}
EXAMPLES = {
    "deckline train dehaze": (
        "deckline train dehaze data/train-* --out runs/dehaze --prior --minutes 60",
        "deckline train dehaze data/mine --out runs/mine --recipe runs/dehaze/recipe.toml --start-from runs/dehaze",
    ),
    "deckline train detect": (
        "deckline train detect data/train-* --out runs/detect --minutes 60",
        "deckline train detect data/train-* pictures --out runs/mine --start-from shipped --lr 2e-4",
    ),
}
