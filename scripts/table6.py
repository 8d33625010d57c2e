"""The paper's Table 6 with all its rows: its rivals and ours, trained on the same views with the same budget.

    python scripts/table6.py RECORDING... --out runs/table6 [--minutes 60 --threads 2 --bf16]

Every network starts from EfficientNet-Lite0's ImageNet weights and is trained in turn; then all are compared on fresh
views of the paper's deck in clear air and on approaches through haze. The same command resumes after a stop; a longer
--minutes goes on from the checkpoints. The deckline commands are printed before they run.
"""

import argparse
import shlex
import subprocess
import sys
from pathlib import Path

OURS = "hybrid"
NETWORKS = ("ufld-lite0", "sad-lite0", "resa-lite0", OURS)  # the paper's UFLD, SAD and LaneDet, and ours


def run(*words: object) -> None:
    """Print and run a deckline command; its error ends the script."""
    command = ["deckline", *map(str, words)]
    print(shlex.join(command), flush=True)
    code = subprocess.run([sys.executable, "-m", *command], check=False).returncode
    if code:
        sys.exit(code)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recordings", type=Path, nargs="+", help="clear, with depth and true lines")
    parser.add_argument("--out", type=Path, required=True, help="folder of the trainings and results")
    parser.add_argument("--network", nargs="+", default=NETWORKS, help="the first one is the table's reference")
    parser.add_argument("--minutes", type=float, default=60.0, help="training time of each network")
    parser.add_argument("--cpu-minutes", action="store_true", help="they are of computing, on all cores together")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--bf16", action="store_true", help="for CPUs with AMX or AVX512-BF16")
    parser.add_argument("--frames", type=int, default=100, help="views of the paper's deck in clear air")
    parser.add_argument("--approaches", type=int, default=10)
    given = parser.parse_args()
    budget = ["--minutes", given.minutes, *(["--cpu-minutes"] if given.cpu_minutes else [])]
    machine = ["--threads", given.threads, "--bf16", given.bf16]
    for name in given.network:
        run("train", "detect", *given.recordings, "--network", name, "--out", given.out / name, *budget, *machine)
    first, *others = (given.out / name / "detect.onnx" for name in given.network)
    views = ["--frames", given.frames, "--deckless", given.frames // 2, "--visibility", "clear"]
    scores = given.out / "scores"
    run("eval", "detectors", "--detector", first, *others, "--dehazer", "none", *views, "--cost", "--out", scores)
    detectors = ["--ufld", first, *(["--rival", *others] if others else [])]
    if OURS in given.network:  # our rows fly the one that is trained here
        detectors += ["--detector", given.out / OURS / "detect.onnx"]
    run("eval", "localization", *detectors, "--approaches", given.approaches, "--out", scores / "table6")


if __name__ == "__main__":
    main()
