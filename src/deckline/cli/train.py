"""`deckline train`: everything behind it needs the train extra."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar, get_args

import tyro

from deckline.config_file import read_config
from deckline.extras import needs_extra
from deckline.runtime import shipped_models, shipped_weights

with needs_extra("train"):
    from deckline.research.dehazers import DEHAZERS
    from deckline.research.detectors import DETECTORS
    from deckline.train import dehaze as train_dehaze
    from deckline.train import detect as train_detect
    from deckline.train.dehaze import DehazeTrainConfig
    from deckline.train.detect import DetectTrainConfig
    from deckline.train.loop import Recipe

R = TypeVar("R", bound=Recipe)
SHIPPED = "shipped"
SWITCHES = ("cpu_minutes", "prior")  # not given, they leave the recipe's value
DehazeNetworkName = Literal[
    "coarse-t",
    "coarse-s",
    "coarse-b",
    "full-t",
    "full-s",
    "full-b",
    "aod-net",
    "gca-net",
    "grid-dehaze-net",
    "g-unet-t",
    "dehaze-former-t",
]
DetectNetworkName = Literal["hybrid", "ufld", "ufld-r18", "enet-sad", "resa-r18"]
Device = Literal["auto", "cpu", "cuda"]


def flag(text: str, default: Any, metavar: str = "N") -> Any:
    """Help of a flag that overrides the recipe; `default` holds where neither says anything."""
    shown = f"(default: {'no limit' if default is None else default}, or the recipe's)"
    return tyro.conf.arg(help=text, metavar=metavar, help_behavior_hint=shown)


def choices(kind: Any) -> str:
    return "{" + ",".join(get_args(kind)) + "}"


@dataclass(frozen=True)
class DehazeFlags:
    """What the command line may change of the recipe."""

    network: Annotated[
        DehazeNetworkName | None,
        flag(
            "ours on a grid of 4 px (coarse) or at full resolution (full), or one to compare it with.",
            DehazeTrainConfig.network,
            choices(DehazeNetworkName),
        ),
    ] = None
    prior: Annotated[
        bool, tyro.conf.arg(help="start from the geometry dehazer's picture, as shipped; coarse networks only.")
    ] = False
    minutes: Annotated[float | None, flag("training time, if that ends before the steps.", None)] = None
    cpu_minutes: Annotated[bool, tyro.conf.arg(help="minutes are of computing: the same on a busy machine.")] = False
    steps: Annotated[int | None, flag("training steps.", DehazeTrainConfig.steps)] = None
    batch: Annotated[int | None, flag("crops a step.", DehazeTrainConfig.batch)] = None
    crop_height: Annotated[int | None, flag("px.", DehazeTrainConfig.crop_height)] = None
    crop_width: Annotated[int | None, flag("px.", DehazeTrainConfig.crop_width)] = None
    lr: Annotated[float | None, flag("largest learning rate.", DehazeTrainConfig.lr)] = None
    visible_share: Annotated[
        float | None, flag("share of the loss on what haze leaves visible.", DehazeTrainConfig.visible_share)
    ] = None
    held_out: Annotated[
        float | None, flag("share of each recording that is validated on.", DehazeTrainConfig.held_out)
    ] = None
    seed: Annotated[int | None, flag("of first weights and of all that is drawn.", DehazeTrainConfig.seed)] = None
    threads: Annotated[int | None, flag("of torch on a CPU.", "torch's choice")] = None
    device: Annotated[Device | None, flag("to train on.", DehazeTrainConfig.device, choices(Device))] = None
    bf16: Annotated[bool | None, flag("half of the arithmetic in bfloat16.", "on CUDA only", "{True,False}")] = None


@dataclass(frozen=True)
class DetectFlags:
    """What the command line may change of the recipe."""

    network: Annotated[
        DetectNetworkName | None,
        flag("a shipped one, or one to compare it with.", DetectTrainConfig.network, choices(DetectNetworkName)),
    ] = None
    minutes: Annotated[
        float | None, flag("training time, if that ends before the steps; inf: no limit.", DetectTrainConfig.minutes)
    ] = None
    cpu_minutes: Annotated[bool, tyro.conf.arg(help="minutes are of computing: the same on a busy machine.")] = False
    steps: Annotated[int | None, flag("training steps.", DetectTrainConfig.steps)] = None
    batch: Annotated[int | None, flag("views a step.", DetectTrainConfig.batch)] = None
    lr: Annotated[float | None, flag("largest learning rate, of the heads.", DetectTrainConfig.lr)] = None
    held_out: Annotated[
        float | None, flag("share of each recording that is validated on.", DetectTrainConfig.held_out)
    ] = None
    seed: Annotated[int | None, flag("of first weights and of all that is drawn.", DetectTrainConfig.seed)] = None
    threads: Annotated[int | None, flag("of torch on a CPU.", "torch's choice")] = None
    device: Annotated[Device | None, flag("to train on.", DetectTrainConfig.device, choices(Device))] = None
    bf16: Annotated[bool | None, flag("half of the arithmetic in bfloat16.", "on CUDA only", "{True,False}")] = None


def dehaze(
    recordings: tyro.conf.Positional[tuple[Path, ...]],
    out: Path,
    recipe: Path | None = None,
    start_from: str | None = None,
    flags: Annotated[DehazeFlags, tyro.conf.arg(name="")] = DehazeFlags(),
) -> int:
    """Train a dehazing network on clear recordings with depth.

    The same command goes on from its own checkpoint in --out, where recipe.toml holds every value that was used.

    Args:
        recordings: folders written by `deckline sim --visibility clear --depth.range-m inf`.
        out: folder of recipe.toml, the checkpoint and dehaze.onnx.
        recipe: TOML file of all that training can be told (see recipe.toml in an --out); flags override it.
        start_from: first weights: folder of an earlier training, .onnx file, shipped, or a shipped model's name.
        flags: over the recipe.
    """
    config = make_recipe(DehazeTrainConfig, recipe, flags)
    first = find_weights(start_from, config.network)
    train_dehaze.train_dehaze(config, list(recordings), out, first, train_dehaze.NETWORKS | DEHAZERS)
    return 0


def detect(
    recordings: tyro.conf.Positional[tuple[Path, ...]],
    out: Path,
    recipe: Path | None = None,
    start_from: str | None = None,
    flags: Annotated[DetectFlags, tyro.conf.arg(name="")] = DetectFlags(),
) -> int:
    """Train a line detector on clear recordings with depth and true lines, or on pictures of your own with labels.json.

    The same command goes on from its own checkpoint in --out, where recipe.toml holds every value that was used. For
    pictures of your own start from shipped weights with a lower --lr, such as 2e-4.

    Args:
        recordings: folders written by `deckline sim --visibility clear --depth.range-m inf`, and folders of pictures
            with labels.json, to which no haze is added; one given twice is drawn twice as often.
        out: folder of recipe.toml, the checkpoint and detect.onnx.
        recipe: TOML file of all that training can be told (see recipe.toml in an --out); flags override it.
        start_from: first weights: folder of an earlier training, .onnx file, shipped, or a shipped model's name.
        flags: over the recipe.
    """
    config = make_recipe(DetectTrainConfig, recipe, flags)
    first = find_weights(start_from, config.network)
    train_detect.train_detect(config, list(recordings), out, first, train_detect.NETWORKS | DETECTORS)
    return 0


def make_recipe(cls: type[R], file: Path | None, flags: DehazeFlags | DetectFlags) -> R:
    """The recipe of a file, or the defaults, with what the flags say."""
    base = cls() if file is None else read_config(cls, file)
    given = {name: value for name, value in vars(flags).items() if value is not None}
    return replace(base, **{name: value for name, value in given.items() if value or name not in SWITCHES})


def find_weights(source: str | None, network: str) -> Path | None:
    """Where first weights lie.

    Args:
        source: `shipped` for the shipped weights of `network`, a shipped model's name, or a path; None for none.
        network: that is trained.

    Raises:
        ValueError: no weights of that network are shipped.
    """
    name = network if source == SHIPPED else source
    if source is None or name is None:
        return None
    return shipped_weights(name) if source == SHIPPED or name in shipped_models() else Path(source)
