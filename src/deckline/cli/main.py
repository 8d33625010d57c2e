"""The `deckline` command."""

import os
import select
import sys
from collections.abc import Callable
from typing import Any

import tyro

from deckline.cli import run as commands

COMMANDS: dict[str, Callable[..., int]] = {
    "demo": commands.demo,
    "run": commands.run,
    "convert": commands.convert,
    "info": commands.info,
}
DESCRIPTION = "Sees a ship's landing deck through haze and says where the aircraft is relative to its lines."
INTERRUPTED = 130  # the shell's code for a program ended by Ctrl-C
UNREAD = 141  # and for one whose output nobody reads any more, as behind `| head`
STDOUT = 1  # its descriptor


def main(argv: list[str] | None = None) -> int:
    """Run one command; returns the exit code. Bad input ends with one line and code 2, Ctrl-C with 130."""
    args = sys.argv[1:] if argv is None else argv
    try:
        code = int(_dispatch(args) or 0)
        sys.stdout.flush()
        return code
    except KeyboardInterrupt:
        print("deckline: stopped; what was written is whole", file=sys.stderr)
        return INTERRUPTED
    except (ValueError, OSError, ImportError) as error:
        if isinstance(error, BrokenPipeError) and _is_unread():
            return UNREAD
        if os.environ.get("DECKLINE_TRACEBACK"):
            raise
        print(f"deckline: error: {' '.join(str(error).split())}", file=sys.stderr)
        return 2


def _is_unread() -> bool:
    """Whether nobody reads our output any more: any other pipe that breaks is an error."""
    output = select.poll()
    output.register(STDOUT, 0)
    if not any(event & select.POLLERR for _, event in output.poll(0)):
        return False
    os.dup2(os.open(os.devnull, os.O_WRONLY), STDOUT)  # or Python would complain when it ends
    return True


def _dispatch(args: list[str]) -> Any:
    alone = ALONE.get(args[0]) if args else None
    if alone is not None:
        return alone(args[1:])
    group = GROUPS.get(args[0]) if args else None
    if group is not None:
        return tyro.extras.subcommand_cli_from_dict(group(), prog=f"deckline {args[0]}", args=args[1:])
    listed = {"sim": _sim, "dataset": _dataset, "train": _train, "eval": _eval, "labels": _labels}  # in the help only
    top = COMMANDS | listed
    return tyro.extras.subcommand_cli_from_dict(top, prog="deckline", description=DESCRIPTION, args=args)


def _run_sim(args: list[str]) -> int:
    from deckline.cli import sim as sim_commands

    return sim_commands.sim(args)


def _run_dataset(args: list[str]) -> int:
    from deckline.cli import sim as sim_commands

    return sim_commands.dataset(args)


def _train_group() -> dict[str, Callable[..., int]]:
    from deckline.cli import train as train_commands

    return {"dehaze": train_commands.dehaze, "detect": train_commands.detect}


def _eval_group() -> dict[str, Callable[..., int]]:
    from deckline.evaluation import (
        ablation,
        commands,
        dehazing,
        detection,
        detectors,
        flicker,
        integrity,
        localization,
    )

    return {
        "chain": commands.chain,
        "recording": commands.recording,
        "labels": commands.labels,
        "flicker": flicker.flicker,
        "ablation": ablation.ablation,
        "dehazing": dehazing.dehazing,
        "detection": detection.detection,
        "detectors": detectors.detectors,
        "integrity": integrity.integrity,
        "localization": localization.localization,
    }


def _labels_group() -> dict[str, Callable[..., int]]:
    from deckline.cli import labels as label_commands

    return {"export": label_commands.export, "import": label_commands.import_}


def _sim() -> int:
    """Render a recording of a deck, or a contact sheet: see deckline sim --help."""
    return main(["sim", "--help"])


def _dataset() -> int:
    """Render the paper's dataset of clear and hazy pairs, or check one: see deckline dataset --help."""
    return main(["dataset", "--help"])


def _train() -> int:
    """Train a network: see deckline train --help."""
    return main(["train", "--help"])


def _eval() -> int:
    """Measure the chain against truth: see deckline eval --help."""
    return main(["eval", "--help"])


def _labels() -> int:
    """Runway labels as TuSimple, CULane or COCO keypoints, and back: see deckline labels --help."""
    return main(["labels", "--help"])


# Imported only when asked for: they need extras.
GROUPS = {"train": _train_group, "eval": _eval_group, "labels": _labels_group}
ALONE = {"sim": _run_sim, "dataset": _run_dataset}


if __name__ == "__main__":
    raise SystemExit(main())
