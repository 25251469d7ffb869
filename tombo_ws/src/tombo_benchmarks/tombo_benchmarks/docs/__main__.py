"""Regenerate pictures, tables and figures of the documentation: `make docs`.

    python -m tombo_benchmarks.docs [--data DIR] [PRODUCT ...]

Without names, all products: some ten minutes on two cores. `git diff` then shows what was out of
date. A product whose shared data are absent is left as it is, and named.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import typer

from tombo_benchmarks.docs.products import PRODUCTS
from tombo_bringup.cli.errors import exit_code_of
from tombo_dynamics.errors import InputError, unknown_name

ROOT = Path(__file__).resolve().parents[5]


def main() -> None:
    """Make the products that are asked for."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("products", nargs="*", metavar="PRODUCT")
    parser.add_argument("--data", type=Path, default=ROOT.parent / "shared" / "data")
    options = parser.parse_args()
    for name in options.products:
        if name not in PRODUCTS:
            raise unknown_name("product", name, PRODUCTS)
    failed = []
    for name in options.products or PRODUCTS:
        try:
            typer.echo(f"{name}: {_make(name, options.data)}")
        except InputError as error:
            typer.echo(f"{name}: failed: {error}")
            failed.append(name)
    if failed:
        raise InputError(f"not made: {', '.join(failed)}; the others are")


def _make(name: str, data: Path) -> str:
    """Make a product; return the written files and the time."""
    product = PRODUCTS[name]
    if product.data and not (data / product.data).is_dir():
        return f"left as it is, no '{data / product.data}'"
    began_s = time.perf_counter()
    product.make(ROOT, data)
    return f"{', '.join(product.written)} ({time.perf_counter() - began_s:.0f} s)"


if __name__ == "__main__":
    sys.exit(exit_code_of(main))
