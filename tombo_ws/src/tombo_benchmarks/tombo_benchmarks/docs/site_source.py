"""Write the sources of the documentation site: `python -m tombo_benchmarks.docs.site_source DIR`.

The pages of `docs/` as they are, with the files that they link to. The reference: commands from
the command line's help, parameters from the records. `make site` builds them with Sphinx, in a
separate environment.
"""

from __future__ import annotations

import argparse
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import typer

from tombo_benchmarks.docs.markdown import table_markdown
from tombo_bringup.cli.main import application

ROOT: Final = Path(__file__).resolve().parents[5]
PROJECT: Final = ("README", "CONTRIBUTING", "CHANGELOG")


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
    shutil.copy(ROOT / "scripts" / "site" / "python_api.rst", reference)
    shutil.copy(ROOT / "scripts" / "site" / "index.md", folder)


def _copy_page(page: Path, folder: Path) -> None:
    """Copy a page and the files that it links to, each to its place in the repository."""
    text = page.read_text(encoding="utf-8")
    for link in set(re.findall(r"\]\(([^)#\s]+)[^)]*\)", text)):
        target = (page.parent / link).resolve()
        if target.is_file() and target.suffix != ".md":
            _copy(target, folder)
        elif target.is_dir():  # a site has no listing of a folder: its name stays
            text = re.sub(rf"\[([^]]+)\]\({re.escape(link)}\)", r"\1", text)
    text = re.sub(r"```mermaid\n(.*?)```", lambda m: arrows(m[1]), text, flags=re.DOTALL)
    place = folder / page.relative_to(ROOT)
    place.parent.mkdir(parents=True, exist_ok=True)
    place.write_text(text, encoding="utf-8")


def arrows(diagram: str) -> str:
    """Return a Mermaid flow chart as a table: drawing it would need a script from elsewhere."""
    names = dict(re.findall(r'(\w+)\["([^"]*)"\]', diagram))
    rows = [
        [names.get(source, source), what, names.get(target, target)]
        for source, what, target in re.findall(
            r'^ *(\w+)\S*(?:\[".*"\])? -- "?([^"\n]*?)"? --> (\w+)', diagram, re.MULTILINE
        )
    ]
    return table_markdown(("from", "what", "to"), rows).replace("<br/>", ", ")


def _copy(file: Path, folder: Path) -> None:
    place = folder / file.relative_to(ROOT)
    place.parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(file, place)


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

    return (
        "# Parameters\n\nAll parameters of the nodes, in the form of `--params-file`. Scenario "
        f"files and `--set` have the same names.\n\n```yaml\n{parameter_file()}```\n"
    )


def main() -> None:
    """Write the sources into the folder that is asked for."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("folder", type=Path)
    write_source(parser.parse_args().folder)


if __name__ == "__main__":
    main()
