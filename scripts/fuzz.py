"""Coverage-guided fuzzing of what reads files, messages and the calls of AirSim's clients, one reader at a time.

    .venv-dev/bin/pip install atheris==3.0.0
    .venv-dev/bin/python scripts/fuzz.py [READER ...] [--minutes 60] [--corpus fuzz-corpus] [--again FILE]

A reader may refuse with a ValueError or OSError. A finding is any other exception, a warning, 10 s or 2 GB for one
input: the fuzzer stops and leaves the input in the corpus as crash-*, timeout-* or oom-*; --again tries such a file.
Source: atheris, libFuzzer for Python, https://github.com/google/atheris
"""

import argparse
import logging
import os
import shutil
import sys
import tempfile
import warnings
from contextlib import nullcontext, redirect_stderr
from io import StringIO
from pathlib import Path

try:
    import atheris
except ImportError:  # --help and --again do without
    atheris = None

ROOT = Path(__file__).parent.parent
sys.path += [str(ROOT / folder) for folder in ("src", "tests/recording", "tests/runtime")]
INSTRUMENTED = ["deckline", "deckline_sim", "deckline_lab", "tomllib", "yaml", "PIL"]
INSTRUMENTED += ["pyulog", "pymavlink.DFReader", "pymavlink.mavutil"]
with nullcontext() if atheris is None else atheris.instrument_imports(include=INSTRUMENTED):
    from fuzz_files import FILES
    from fuzz_messages import MESSAGES

ALL = FILES | MESSAGES
WORDS = (
    *("inf", "nan", "1e999", "1e308", "-1", "0", "4294967296", "9223372036854775807", "null", "true", "NaN"),
    "[]",
    "{}",
)
LIMITS = ("-timeout=10", "-rss_limit_mb=2048", "-max_len=16384", "-len_control=0")


def fuzz(name: str, corpus: Path, seconds: float, again: Path | None) -> None:
    """Fuzz one reader; ends the process."""
    reader, corpus = ALL[name](), corpus / name
    corpus.mkdir(parents=True, exist_ok=True)
    for number, seed in enumerate(reader.seeds):
        (corpus / f"seed-{number}").write_bytes(seed)
    words = corpus.with_suffix(".words")
    words.write_text("".join(f'"{word}"\n' for word in WORDS))
    logging.disable()
    work = Path(tempfile.mkdtemp(dir="/dev/shm"))

    def attempt(data: bytes) -> None:
        folder = work / "x"
        with warnings.catch_warnings(), redirect_stderr(StringIO()):
            warnings.simplefilter("error")
            try:
                folder.mkdir()
                reader.use(folder, data)
            except (ValueError, OSError):
                return
            finally:
                shutil.rmtree(folder)

    if again is not None:
        return attempt(again.read_bytes())
    arguments = [*LIMITS, f"-max_total_time={seconds:.0f}", f"-artifact_prefix={corpus}/"]
    atheris.Setup([sys.argv[0], *arguments, f"-dict={words}", str(corpus)], attempt)
    atheris.Fuzz()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("readers", nargs="*", choices=[*ALL, []], metavar="READER", help=f"of {', '.join(ALL)}; all")
    parser.add_argument("--minutes", type=float, default=60.0, help="for all of them together")
    parser.add_argument("--corpus", type=Path, default=Path("fuzz-corpus"))
    parser.add_argument("--again", type=Path)
    options = parser.parse_args()
    if atheris is None and options.again is None:
        parser.error("atheris is not installed; run: pip install atheris==3.0.0")
    names = options.readers or list(ALL)
    for name in names:
        print(f"\n== {name}", flush=True)
        if not (child := os.fork()):  # libFuzzer ends its process
            fuzz(name, options.corpus, 60.0 * options.minutes / len(names), options.again)
            return
        _, status = os.waitpid(child, 0)
        print(f"== {name}: {'FINDING' if status else 'no finding'}", flush=True)


if __name__ == "__main__":
    main()
