"""Write the sources of the documentation site: `python -m tombo_benchmarks.docs.site_source DIR`.

The pages of `docs/` as they are, with what they link to, and the reference that is generated:
commands from the command line's own help, parameters from the records, Python from docstrings.
`make site` builds them with Sphinx, in an environment of its own.
"""

from __future__ import annotations

import argparse
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import typer

from tombo_bringup.cli.main import application

ROOT: Final = Path(__file__).resolve().parents[5]
SECTIONS: Final = {
    "Tutorials": (
        "first_flight",
        "first_diagnosis",
        "first_real_flight",
        "own_vehicle",
        "own_collision",
    ),
    "How to": (
        *(
            "live",
            "report",
            "nodes",
            "px4",
            "safety",
            "recording",
            "replay",
            "logs",
            "diagnosis",
            "changed",
        ),
        *("reactions", "python", "sweep", "gym", "propeller", "design", "stand", "beta"),
    ),
    "Reference": ("faults", "figures", "effects", "conventions", "glossary"),
    "Explanation": (
        *("architecture", "model", "control", "collision", "diagnosis_method"),
        *("diagnosis_benchmarks", "calibration", "reproduction"),
    ),
}
"""Heading → pages of `docs/`, in the order in which they are offered; others are of *How to*."""
PROJECT: Final = ("README", "CONTRIBUTING", "CHANGELOG")
GENERATED: Final = ("commands", "parameters", "python_api")
MODULES: Final = (
    *("tombo", "tombo.gym", "tombo_dynamics.core", "tombo_dynamics.effects.registry"),
    *("tombo_collision.reactions", "tombo_bag.flight", "tombo_flight.report.page"),
)
"""Modules of the API: the public interface, and what an addition subclasses or returns."""


def write_source(folder: Path) -> None:
    """Write pages, pictures, linked files and generated reference into an empty folder."""
    pages = sorted((ROOT / "docs").glob("*.md"))
    shutil.rmtree(folder, ignore_errors=True)
    for page in (*pages, *(ROOT / f"{name}.md" for name in PROJECT)):
        _copy_page(page, folder)
    reference = folder / "reference"
    reference.mkdir()
    (reference / "commands.md").write_text(commands_page(), encoding="utf-8")
    (reference / "parameters.md").write_text(parameters_page(), encoding="utf-8")
    (reference / "python_api.rst").write_text(api_page(), encoding="utf-8")
    (folder / "index.md").write_text(index_page(), encoding="utf-8")


def _copy_page(page: Path, folder: Path) -> None:
    """Copy a page and the files that it links to, each to its place in the repository."""
    text = page.read_text(encoding="utf-8")
    for link in set(re.findall(r"\]\(([^)#\s]+)[^)]*\)", text)):
        target = (page.parent / link).resolve()
        if target.is_file() and target.suffix != ".md":
            _copy(target, folder)
        elif target.is_dir():  # a site has no listing of a folder: its name stays
            text = re.sub(rf"\[([^]]+)\]\({re.escape(link)}\)", r"\1", text)
    # Diagrams would need a script from elsewhere: their text is legible.
    text = text.replace("```mermaid", "```text")
    place = folder / page.relative_to(ROOT)
    place.parent.mkdir(parents=True, exist_ok=True)
    place.write_text(text, encoding="utf-8")


def _copy(file: Path, folder: Path) -> None:
    place = folder / file.relative_to(ROOT)
    place.parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(file, place)


def index_page() -> str:
    """Return the first page: what there is, in the order of what a reader wants."""
    text = [
        "# Tombo",
        "",
        "A ROS 2 suite for a quadrotor with folding propellers: simulation, flight through a "
        "collision, and diagnosis of measured flights. Begin with the "
        "[first flight](docs/first_flight.md).",
        "",
    ]
    listed = {name for names in SECTIONS.values() for name in names}
    others = sorted({page.stem for page in (ROOT / "docs").glob("*.md")} - listed)
    for heading, names in SECTIONS.items():
        entries = [f"docs/{name}" for name in (*names, *(others if heading == "How to" else ()))]
        if heading == "Reference":
            entries = [f"reference/{name}" for name in GENERATED] + entries
        text += ["```{toctree}", f":caption: {heading}", ":maxdepth: 1", "", *entries, "```", ""]
    text += ["```{toctree}", ":caption: The project", ":maxdepth: 1", "", *PROJECT, "```", ""]
    return "\n".join(text)


def commands_page() -> str:
    """Return every command with its arguments and options, as its `--help` has them."""
    lines = ["# Commands", "", "Each command with `--help` prints the same."]
    for words, command in _commands(typer.main.get_command(application()), ("tombo",)):
        lines += ["", f"## {' '.join(words)}", "", _plain(command.help)]
        rows = [row for row in map(_row, command.params) if row]
        if rows:
            lines += ["", "| option | default | what |", "|---|---|---|", *rows]
    return "\n".join(lines) + "\n"


def _commands(command: Any, words: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], Any]]:
    if not hasattr(command, "commands"):
        yield words, command
        return
    for name, inner in command.commands.items():
        if not inner.hidden:
            yield from _commands(inner, (*words, name))


def _row(param: Any) -> str:
    help_text = getattr(param, "help", None) or ""
    if getattr(param, "hidden", False) or param.name == "help":
        return ""
    names = ", ".join(f"`{name}`" for name in param.opts)
    if param.param_type_name == "argument":
        names = f"`{param.metavar or param.name.upper()}`"
    default = param.default
    shown = "" if callable(default) or default in (None, (), [], False, ...) else f"`{default}`"
    return f"| {names} | {shown} | {_plain(help_text)} |"


def _plain(text: str | None) -> str:
    """Return help as Markdown text: no line ends, nothing that is markup by accident."""
    words = " ".join((text or "").replace("\b", "").split())
    return re.sub(r"([|<>\[\]*_#])", r"\\\1", words)


def parameters_page() -> str:
    """Return the file of all parameters, with unit, bounds and meaning of each."""
    from tombo_benchmarks.docs.parameter_file import parameter_file

    head = (
        "# Parameters\n\nAll parameters of the nodes, in the form of `--params-file`. Scenario "
        "files and `--set` have the same names.\n\n```yaml\n"
    )
    return f"{head}{parameter_file()}```\n"


def api_page() -> str:
    """Return the directives by which Sphinx reads signatures and docstrings."""
    text = (
        "Python API\n==========\n\n"
        "Signatures and docstrings. What is public: :doc:`/docs/python`.\n"
    )
    for name in MODULES:
        text += f"\n{name}\n{'-' * len(name)}\n\n.. automodule:: {name}\n   :members:\n"
    return text


def main() -> None:
    """Write the sources into the folder that is asked for."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("folder", type=Path)
    write_source(parser.parse_args().folder)


if __name__ == "__main__":
    main()
