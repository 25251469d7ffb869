"""Flies rotorpy, crazyflow and this simulator on the same course in turn, and counts steps."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from tombo_benchmarks.docs.markdown import updated
from tombo_benchmarks.peers.peer_process import default_folder
from tombo_benchmarks.peers.peers_benchmark import measure
from tombo_benchmarks.peers.peers_page import peers_markdown, peers_page
from tombo_bringup.cli.tables import show_page


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="python -m tombo_benchmarks.peers", description=__doc__)
    parser.add_argument("--rounds", type=int, default=5, help="of all cases (default: 5)")
    parser.add_argument(
        "--environments", type=Path, default=default_folder(), metavar="FOLDER",
        help="keeps their environments, made at the first run: 1.6 GB (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument("--json", action="store_true", help="print JSON only")
    parser.add_argument(
        "--page", type=Path, metavar="FILE",
        help="also write the table between the markers <!-- peers --> and <!-- /peers --> of it",
    )  # fmt: skip
    chosen = parser.parse_args(arguments)
    if not 1 <= chosen.rounds <= 1000:
        parser.error(f"--rounds {chosen.rounds}: out of bounds; accepted: 1 to 1000")
    waiting = Console(stderr=True)
    with waiting.status("measuring") as status:
        result = measure(chosen.environments.absolute(), chosen.rounds, status.update)
    page = peers_page(result)
    if chosen.page is not None:
        text = chosen.page.read_text(encoding="utf-8")
        chosen.page.write_text(updated(text, {"peers": peers_markdown(page.data)}))
    show_page(page, chosen.json)


if __name__ == "__main__":
    main()
