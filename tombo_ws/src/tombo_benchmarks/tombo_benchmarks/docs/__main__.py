"""Regenerate pictures, tables and figures of the documentation: `make docs`.

    python -m tombo_benchmarks.docs [--check] [--data DIR] [PRODUCT ...]

Without names, all products. It takes some ten minutes on two cores. A product whose shared data
are absent is left as it is, and named.
"""

from __future__ import annotations

import argparse
import shutil
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import typer

from tombo_benchmarks.docs.lock import (
    code_hash,
    content_hash,
    read_lock,
    reference_flights,
    write_lock,
)
from tombo_benchmarks.docs.products import FLIGHTS, LEFT, PRODUCTS, Product
from tombo_bringup.cli.errors import exit_code_of
from tombo_dynamics.errors import InputError, unknown_name

ROOT = Path(__file__).resolve().parents[5]


def main() -> None:
    """Make the products that are asked for and note them in the lock file."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("products", nargs="*", metavar="PRODUCT")
    parser.add_argument("--check", action="store_true", help="only say what is out of date")
    parser.add_argument("--data", type=Path, default=ROOT.parent / "shared" / "data")
    options = parser.parse_args()
    names = [product.name for product in PRODUCTS]
    for name in options.products:
        if name not in names:
            raise unknown_name("product", name, names)
    chosen = [p for p in PRODUCTS if not options.products or p.name in options.products]
    if options.check:
        found = [line for product in chosen for line in out_of_date(product)]
        if found:
            raise InputError("; ".join(found))
        return
    failed = []
    for product in chosen:
        try:
            _make(product, options.data)
        except InputError as error:
            typer.echo(f" failed: {error}")
            failed.append(product.name)
    for line in LEFT:
        typer.echo(f"left: {line}")
    if failed:
        raise InputError(f"not made: {', '.join(failed)}; the others are")


def _make(product: Product, data: Path) -> None:
    if product.data is not None and not (data / product.data).is_dir():
        typer.echo(
            f"left: {product.name} ({', '.join(product.written)}): no '{data / product.data}'"
        )
        return
    began = time.perf_counter()
    typer.echo(f"{product.name}: {', '.join(product.written)}", nl=False)
    product.make(ROOT, data)
    typer.echo(f" ({time.perf_counter() - began:.0f} s)")
    if product.quick:
        return
    lock = read_lock(ROOT)
    lock[product.name] = {
        "command": f"make docs ARGS={product.name}",
        "code": code_hash(ROOT, _code(product)) if _code(product) else None,
        "written": {place: content_hash(ROOT, place) for place in product.written},
    }
    if FLIGHTS in product.depends:
        lock[product.name][FLIGHTS] = reference_flights()
    write_lock(ROOT, lock)


def _code(product: Product) -> list[str]:
    return [folder for folder in product.depends if folder != FLIGHTS]


def out_of_date(product: Product, flights: object = None) -> list[str]:
    """Return why a product is out of date, one line each.

    Args:
        product: one that is in the lock file, or that is quickly made again.
        flights: what `reference_flights` gives; flown if None.
    """
    run = f"run `make docs ARGS={product.name}`"
    if product.quick:
        return [f"{file} is not what the code gives; {run}" for file in _changed_files(product)]
    noted = read_lock(ROOT).get(product.name)
    if noted is None:
        return [f"{product.name}: not in docs/figures.lock; {run}"]
    found = [
        f"{place} is not as it was written; {run}"
        for place, digest in noted["written"].items()
        if content_hash(ROOT, place) != digest
    ]
    if _code(product) and code_hash(ROOT, _code(product)) != noted["code"]:
        found.append(f"{product.name}: the code of {', '.join(_code(product))} changed; {run}")
    if FLIGHTS in product.depends and noted[FLIGHTS] != (flights or reference_flights()):
        found.append(f"{product.name}: the reference flights come out otherwise; {run}")
    return found


def _changed_files(product: Product) -> list[str]:
    """Make a product in a copy of its files; return those that come out otherwise."""
    with TemporaryDirectory() as folder:
        copy = Path(folder)
        for file in product.files:
            (copy / file).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(ROOT / file, copy / file)
        product.make(copy, copy)
        return [
            f for f in sorted(product.files) if (ROOT / f).read_bytes() != (copy / f).read_bytes()
        ]


if __name__ == "__main__":
    sys.exit(exit_code_of(main))
