"""The commands by name. A command's module is imported when it is chosen: the simulator and the lab need extras."""

import inspect
import sys
import textwrap
from collections.abc import Callable, Collection
from difflib import get_close_matches
from importlib import import_module
from typing import Any, NamedTuple

from deckline.extras import needs_extra


class CliCommand(NamedTuple):
    """Where a command lies: its module has COMMANDS, functions by name, and may have EXAMPLES, lines by command.

    A function that is imported only when its command is chosen is a text, "module:function".
    """

    module: str
    summary: str
    extra: str = ""  # that its module needs
    is_group: bool = False  # of commands


TABLE = {
    "demo": CliCommand("deckline.cli.run", "Fly the shipped sample approach: report, film and guidance in demo-out."),
    "run": CliCommand("deckline.cli.run", "Find the runway in a recording, pictures, a video, or live in a simulator."),
    "live": CliCommand("deckline.cli.live", "Guide from a camera, a network stream or a simulator, as JSON lines."),
    "calibrate": CliCommand(
        "deckline.cli.calibrate", "Estimate mounting, camera and delay of the poses from an approach."
    ),
    "convert": CliCommand("deckline.cli.convert", "Copy a recording into deckline's layout, AirSim's, or a ROS bag."),
    "info": CliCommand("deckline.cli.info", "Print versions, the processor, the engines and the shipped weights."),
    "sim": CliCommand("deckline_sim.cli", "Render a recording of a deck, or serve AirSim's clients.", "sim"),
    "dataset": CliCommand("deckline_lab.cli.dataset", "Render the paper's dataset of hazy pairs, or check one.", "sim"),
    "land": CliCommand("deckline_lab.cli.land", "Land once through haze in a closed loop: film and report.", "sim"),
    "campaign": CliCommand(
        "deckline_lab.cli.campaign", "Fly thousands of landings, on this machine or on Ray, and report them.", "sim"
    ),
    "benchmark": CliCommand("deckline_lab.cli.benchmark", "Measure how long every stage takes on this machine."),
    "train": CliCommand("deckline_lab.cli.train", "Train a network.", "train", is_group=True),
    "eval": CliCommand("deckline_lab.cli.eval", "Measure the chain against truth.", "sim", is_group=True),
    "reproduce": CliCommand("deckline_lab.cli.reproduce", "Print the paper's Tables 4, 5 and 6 beside ours.", "train"),
    "labels": CliCommand(
        "deckline_lab.cli.labels", "Write or read runway labels in other tools' formats.", is_group=True
    ),
}
EXAMPLES = ("deckline demo", "deckline run flights/first --out out --deck-z-m -18")
DESCRIPTION = "Detects a ship's landing deck through haze and estimates where the aircraft is relative to its lines."
HELP = ("-h", "--help")
HELP_COLUMNS = 100


def run_command(args: list[str]) -> Any:
    """Run the command that the arguments begin with; returns what it returns.

    Raises:
        ValueError: an unknown command, or what the command refuses.
        SystemExit: help was printed, or the arguments are no options of the command.
    """
    import tyro

    name, rest = _choose("deckline", DESCRIPTION, TABLE, lambda name: TABLE[name].summary, EXAMPLES, args)
    command, prog = TABLE[name], f"deckline {name}"
    with needs_extra(command.extra):
        module = import_module(command.module)
    functions: dict[str, Callable[..., int] | str] = module.COMMANDS
    examples: dict[str, tuple[str, ...]] = getattr(module, "EXAMPLES", {})
    if command.is_group:

        def summarise(name: str) -> str:
            return " ".join(_description(_load(functions[name], command.extra)).partition("\n\n")[0].split())

        name, rest = _choose(prog, command.summary, functions, summarise, examples.get(prog, ()), rest)
        prog = f"{prog} {name}"
    function = _load(functions[name], command.extra)
    if hasattr(module, "PARSED_BY_COMMAND"):
        return function(rest)
    description = _format_examples(examples.get(prog, ())) + _description(function)
    return tyro.cli(function, prog=prog, description=description, args=rest)


def _load(function: Callable[..., int] | str, extra: str) -> Callable[..., int]:
    """A command's function, imported where it is a text; its module needs the extra."""
    if not isinstance(function, str):
        return function
    module, _, name = function.partition(":")
    with needs_extra(extra):
        return getattr(import_module(module), name)


def _choose(
    prog: str,
    description: str,
    names: Collection[str],
    summarise: Callable[[str], str],
    examples: tuple[str, ...],
    args: list[str],
) -> tuple[str, list[str]]:
    """The command that the arguments begin with, and the arguments after it; summaries are for the help alone.

    Raises:
        ValueError: an unknown command.
        SystemExit: help was asked for, or no command was given; the help is printed.
    """
    if args and args[0] in names:
        return args[0], args[1:]
    if args and args[0] not in HELP:
        near = get_close_matches(args[0], names, n=1)
        hint = f"; did you mean {near[0]!r}?" if near else ""
        raise ValueError(f"{prog} has no command {args[0]!r}, only {', '.join(names)}{hint}")
    width = max(map(len, names)) + 4
    rows = [
        textwrap.fill(
            summarise(key), HELP_COLUMNS, initial_indent=f"  {key:{width - 2}}", subsequent_indent=" " * width
        )
        for key in names
    ]
    parts = (
        f"usage: {prog} [-h] {{{','.join(names)}}} ...",
        _format_examples(examples) + description,
        "commands:\n" + "\n".join(rows),
    )
    print("\n\n".join((*parts, f"{prog} COMMAND --help lists its options.")), file=sys.stdout if args else sys.stderr)
    raise SystemExit(0 if args else 2)


def _format_examples(lines: tuple[str, ...]) -> str:
    text = "".join(f"\n  {line}" for line in lines)
    return f"examples:{text}\n\n" if text else ""


def _description(command: Callable[..., int]) -> str:
    return (inspect.getdoc(command) or "").partition("\n\nArgs:")[0]
