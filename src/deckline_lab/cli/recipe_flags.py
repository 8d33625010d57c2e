"""What both trainings read from the command line: flags over a recipe, shipped recipes and first weights by name."""

from dataclasses import make_dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar, get_args

import tyro

from deckline.config_file import read_config
from deckline.files import is_there
from deckline.runtime import shipped_models, shipped_weights
from deckline_lab import train
from deckline_lab.rivals import LAB_WEIGHTS
from deckline_lab.train.loop import Recipe

R = TypeVar("R", bound=Recipe)
SHIPPED = "shipped"
RECIPES = Path(train.__file__).parent / "recipes"  # shipped: a training's settings by the recipe's name
SWITCHES = ("cpu_minutes", "prior", "tensorboard")  # not given, they leave the recipe's value
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


def make_recipe(cls: type[R], source: Path | None, flags: Any) -> R:
    """The recipe of a file or a shipped one's name, or the defaults, overridden by the flags.

    Raises:
        ValueError: neither a file nor a shipped recipe, or one with wrong values.
    """
    shipped = shipped_recipes()
    if source is not None and str(source) not in shipped and not is_there(source):
        raise ValueError(f"no recipe {source}: give a file, or one of {', '.join(shipped)}")
    base = cls() if source is None else read_config(cls, shipped.get(str(source), source))
    given = {name: value for name, value in vars(flags).items() if value is not None}
    return replace(base, **{name: value for name, value in given.items() if value or name not in SWITCHES})


def shipped_recipes() -> dict[str, Path]:
    """Files of the shipped recipes by name."""
    return {file.stem: file for file in sorted(RECIPES.glob("*.toml"))}


def find_weights(source: str | None, network: str) -> Path | None:
    """Where first weights lie: `shipped` means those of `network`; else a shipped model's name, a path, or None."""
    if source is None:
        return None
    if source == SHIPPED or source in shipped_models():
        return shipped_weights(network if source == SHIPPED else source)
    return shipped_weights(source, LAB_WEIGHTS) if source in shipped_models(LAB_WEIGHTS) else Path(source)
