"""Write the sources of the documentation site: `python -m tombo_benchmarks.docs.site_source DIR`.

The pages of `docs/` as they are, with the files that they link to. The reference: commands from
the command line's help, parameters from the records. `make site` builds them with Sphinx, in a
separate environment.
"""

from __future__ import annotations

import argparse
import re
import shutil
from pathlib import Path
from typing import Final

import typer
from typer.cli import get_docs_for_click

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
    command = typer.main.get_command(application())
    return get_docs_for_click(
        obj=command, ctx=typer.Context(command), name="tombo", title="Commands"
    )


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
