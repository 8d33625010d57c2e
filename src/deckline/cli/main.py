"""The `deckline` command."""

import inspect
import os
import select
import sys
import textwrap
from collections.abc import Callable, Mapping
from difflib import get_close_matches
from typing import Any

import tyro

from deckline import __version__
from deckline.files import print_line

SUMMARIES = {
    "demo": "Fly the shipped sample approach through haze: report, film and guidance in demo-out.",
    "run": "Find the runway in a recording, an image folder, a video, or live in a simulator.",
    "live": "Guide from a camera, a network stream or a simulator, as JSON lines.",
    "convert": "Copy an AirSim recording into deckline's layout, or back; or to and from ROS bags.",
    "info": "Print versions, the processor, the engines and the shipped weights.",
    "sim": "Render a recording of a deck, or serve AirSim's clients.",
    "dataset": "Render the paper's dataset of clear and hazy pairs, or check one.",
    "benchmark": "Measure how long every stage takes on this machine.",
    "train": "Train a network.",
    "eval": "Measure the chain against truth.",
    "reproduce": "Print the paper's Tables 4, 5 and 6 beside the paper's figures, saved or made anew.",
    "labels": "Write runway labels as TuSimple, CULane, COCO keypoints, YOLO-pose or labelme, and read them.",
}
EXAMPLES = {
    "deckline train dehaze": (
        "deckline train dehaze data/train-* --out runs/dehaze --prior --minutes 60",
        "deckline train dehaze data/mine --out runs/mine --recipe runs/dehaze/recipe.toml --start-from runs/dehaze",
    ),
    "deckline train detect": (
        "deckline train detect data/train-* --out runs/detect --minutes 60",
        "deckline train detect data/train-* pictures --out runs/mine --start-from shipped --lr 2e-4",
    ),
    "deckline": ("deckline demo", "deckline run flights/first --out out --deck-z-m -18"),
    "deckline run": (
        "deckline run flights/first --out out --deck-z-m -18",
        "deckline run approach.mp4 --out out --camera camera.toml --poses poses.csv --every 3 --start 60 --duration 30",
    ),
    "deckline live": (
        "deckline live camera:0 --camera camera.toml --poses udp://0.0.0.0:5601 --deck-z-m -18",
        "deckline live udp://0.0.0.0:5600 --to udp://127.0.0.1:5602 --out flight --record",
    ),
    "deckline benchmark": (
        "deckline benchmark --threads 2",
        "deckline benchmark flights/first --device openvino --precision bf16 --out profile.json",
    ),
    "deckline reproduce": (
        "deckline reproduce table6",
        "deckline reproduce table4 --runs runs --minutes 7",
    ),
    "deckline eval": ("deckline eval chain --frames 50 --json figures/chain.json", "deckline eval report figures"),
    "deckline eval chain": ("deckline eval chain --frames 50", "deckline eval chain --preset cvn --out scores"),
    "deckline eval recording": (
        "deckline eval recording flights/first",
        "deckline eval recording flights/first --dehazer none --json figures/first.json",
    ),
    "deckline eval labels": ("deckline eval labels photos", "deckline eval labels photos --detector mine/detect.onnx"),
    "deckline eval detection": (
        "deckline eval detection --frames 50 --preset paper cvn",
        "deckline eval detection flights/first --out scores --worst 5",
    ),
    "deckline eval detectors": (
        "deckline eval detectors --frames 50 --detector hybrid ufld",
        "deckline eval detectors flights/first --dehazer none coarse-t",
    ),
    "deckline eval dehazing": (
        "deckline eval dehazing data/test --cost",
        "deckline eval dehazing photographs --dehazer geometry mine/dehaze.onnx --blind sheets",
    ),
    "deckline eval flicker": (
        "deckline eval flicker flights/first",
        "deckline eval flicker flights/first --dehazer coarse-t --every 2",
    ),
    "deckline eval ablation": (
        "deckline eval ablation data --out ablation --steps 3000",
        "deckline eval ablation data --out ablation --minutes 60",
    ),
    "deckline eval localization": (
        "deckline eval localization --points --approaches 20",
        "deckline eval localization --approaches 4 --out table6",
    ),
    "deckline eval integrity": (
        "deckline eval integrity --jobs 0 --out faults",
        "deckline eval integrity --runs 5 --nominal 20 --sea-state 4",
    ),
    "deckline eval report": (
        "deckline eval report figures",
        "deckline eval report figures --out docs/results.md",
    ),
}
DESCRIPTION = "Sees a ship's landing deck through haze and says where the aircraft is relative to its lines."
GROUPS = ("train", "eval", "labels")
HELP = ("-h", "--help")
HELP_COLUMNS = 100
INTERRUPTED = 130  # the shell's code for a program ended by Ctrl-C
UNREAD = 141  # and for one whose output nobody reads any more, as behind `| head`
LONGEST_ERROR = 2000  # characters
STDOUT = 1  # its descriptor


def main(argv: list[str] | None = None) -> int:
    """Run one command; returns the exit code. Bad input ends with one line and code 2, Ctrl-C with 130.

    A command that is interrupted says what it wrote in the text of its KeyboardInterrupt.
    """
    args = sys.argv[1:] if argv is None else argv
    try:
        code = int(_run_command(args) or 0)
        sys.stdout.flush()
        return code
    except KeyboardInterrupt as interrupt:
        print_line(": ".join(filter(None, ("deckline: stopped", str(interrupt)))))
        return INTERRUPTED
    except (ValueError, OSError, ImportError, MemoryError) as error:
        if isinstance(error, BrokenPipeError) and _is_unread():
            return UNREAD
        if os.environ.get("DECKLINE_TRACEBACK"):
            raise
        print_line(f"deckline: error: {textwrap.shorten(str(error), LONGEST_ERROR, placeholder=' ...')}")
        return 2


def _is_unread() -> bool:
    """Whether nobody reads our output any more: any other pipe that breaks is an error."""
    output = select.poll()
    output.register(STDOUT, 0)
    if not any(event & select.POLLERR for _, event in output.poll(0)):
        return False
    os.dup2(os.open(os.devnull, os.O_WRONLY), STDOUT)  # or Python would complain when it ends
    return True


def _run_command(args: list[str]) -> Any:
    if args == ["--version"]:
        print(f"deckline {__version__}")
        return 0
    name, rest = _choose("deckline", DESCRIPTION, SUMMARIES, args)
    prog = f"deckline {name}"
    if name in ("sim", "dataset"):  # they parse their arguments themselves
        from deckline.cli import sim as sim_commands

        return sim_commands.sim(rest) if name == "sim" else sim_commands.dataset(rest)
    commands = _load_commands(name)
    if name in GROUPS:
        summaries = {key: " ".join(_description(f).partition("\n\n")[0].split()) for key, f in commands.items()}
        name, rest = _choose(prog, SUMMARIES[name], summaries, rest)
        prog = f"{prog} {name}"
    return tyro.cli(commands[name], prog=prog, description=_examples(prog) + _description(commands[name]), args=rest)


def _choose(prog: str, description: str, summaries: Mapping[str, str], args: list[str]) -> tuple[str, list[str]]:
    """The command that the arguments begin with, and the arguments after it.

    Raises:
        ValueError: an unknown command.
        SystemExit: help was asked for, or no command was given; the help is printed.
    """
    if args and args[0] in summaries:
        return args[0], args[1:]
    if args and args[0] not in HELP:
        near = get_close_matches(args[0], summaries, n=1)
        hint = f"; did you mean {near[0]!r}?" if near else ""
        raise ValueError(f"{prog} has no command {args[0]!r}, only {', '.join(summaries)}{hint}")
    width = max(map(len, summaries)) + 4
    rows = [
        textwrap.fill(text, HELP_COLUMNS, initial_indent=f"  {key:{width - 2}}", subsequent_indent=" " * width)
        for key, text in summaries.items()
    ]
    parts = (
        f"usage: {prog} [-h] {{{','.join(summaries)}}} ...",
        _examples(prog) + description,
        "commands:\n" + "\n".join(rows),
    )
    print("\n\n".join((*parts, f"{prog} COMMAND --help lists its options.")), file=sys.stdout if args else sys.stderr)
    raise SystemExit(0 if args else 2)


def _examples(prog: str) -> str:
    lines = "".join(f"\n  {line}" for line in EXAMPLES.get(prog, ()))
    return f"examples:{lines}\n\n" if lines else ""


def _description(command: Callable[..., int]) -> str:
    return (inspect.getdoc(command) or "").partition("\n\nArgs:")[0]


def _load_commands(name: str) -> dict[str, Callable[..., int]]:
    """The commands of a group, or a command by itself. Imported only when asked for: they need extras."""
    functions: tuple[Callable[..., int], ...]
    if name == "train":
        from deckline.cli import train

        functions = (train.dehaze, train.detect)
    elif name == "eval":
        from deckline.evaluation import chain, dehazing, detection, flicker, integrity, localization, tables
        from deckline.research.ablation import ablation

        functions = (chain.chain, chain.recording, chain.labels, flicker.flicker, ablation, dehazing.dehazing)
        functions += (detection.detection, detection.detectors, integrity.integrity, localization.localization)
        functions += (tables.report,)
    elif name == "labels":
        from deckline.cli.labels import export, import_

        functions = (export, import_)
    elif name == "reproduce":
        from deckline.research.reproduce import reproduce

        functions = (reproduce,)
    elif name == "benchmark":
        from deckline.cli.benchmark import benchmark

        functions = (benchmark,)
    else:
        from deckline.cli.convert import convert
        from deckline.cli.info import info
        from deckline.cli.live import live
        from deckline.cli.run import demo, run

        functions = (demo, run, live, convert, info)
    return {function.__name__.strip("_"): function for function in functions}
