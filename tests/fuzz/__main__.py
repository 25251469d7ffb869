"""Damage files of every kind and read them: `python -m tests.fuzz --count 5000 --first 0`.

Prints what went wrong, with the seed and the sample that show it again (`--only NAME --first
SEED --count 1 --keep FILE` writes that file), and leaves with 1 if anything did.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

from .mutate import mutated
from .pool import fuzz
from .samples import make_samples


def tell(text: str) -> None:
    """Print a fault at once: a run may be ended early."""
    print(text, flush=True)


def main() -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("--count", type=int, default=1000, help="files to damage")
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--only", default="", help="part of the names of samples to take")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--keep", type=Path, help="write the first damaged file there, and leave")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="tombo-fuzz-") as folder:
        samples = [s for s in make_samples(Path(folder) / "whole") if given.only in s.name]
        if given.keep is not None:
            mutated(samples[0].path, given.keep, samples[0].form, given.first)
            return 0
        done = fuzz(
            samples, range(given.first, given.first + given.count), given.workers, folder, tell
        )
    print(
        f"{done.accepted + done.refused + len(done.faults)} files: {done.accepted} accepted, "
        f"{done.refused} refused, {len(done.faults)} faults; longest {done.longest_s:.1f} s "
        f"({done.longest})"
    )
    return 1 if done.faults else 0


if __name__ == "__main__":
    sys.exit(main())
