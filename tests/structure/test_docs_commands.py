"""Commands in the documentation are ones that `tombo` accepts, with options that exist."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest
import typer
from typer.exceptions import TyperException

from tombo_bringup.cli.main import application
from tombo_dynamics.errors import InputError

ROOT = Path(__file__).parents[2]
PAGES = [*sorted((ROOT / "docs").glob("*.md")), ROOT / "README.md", ROOT / "CONTRIBUTING.md"]
BLOCK = re.compile(r"^```(?:sh|bash|console)?\n(.*?)^```", re.M | re.S)
COMMAND = re.compile(r"^(?:\.venv/bin/)?tombo +(.*)$", re.M)
MAKE = re.compile(r"^make +(\w[\w-]*)", re.M)


def commands_of(page):
    """Return the arguments of each `tombo` in a block of the page."""
    blocks = "\n".join(BLOCK.findall(page.read_text(encoding="utf-8")))
    lines = COMMAND.findall(re.sub(r"\\\n\s*", " ", blocks))
    words = (shlex.split(line, comments=True) for line in lines)
    stop = ("|", ">", "&&", "&", ";", "2>&1")
    return [
        line[: min([line.index(w) for w in stop if w in line], default=len(line))]
        for line in words
        if "…" not in line and "..." not in line
    ]


def parse(words):
    """Parse a command line as `tombo` does, without running it."""
    command, name = typer.main.get_command(application()), "tombo"
    while hasattr(command, "resolve_command"):
        context = command.make_context(name, list(words))
        words = [*context._protected_args, *context.args]
        if not words:
            return
        name, command, words = command.resolve_command(context, words)
    command.make_context(name, list(words))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_command_of_a_page_is_accepted(page):
    wrong = []
    for words in commands_of(page):
        try:
            parse(words)
        except typer.Exit:  # of --help
            pass
        except (TyperException, InputError) as error:
            wrong.append(f"tombo {shlex.join(words)}: {error}")
    assert wrong == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_target_of_make_is_one(page):
    targets = set(re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(), re.M))
    blocks = "\n".join(BLOCK.findall(page.read_text(encoding="utf-8")))
    assert set(MAKE.findall(blocks)) - targets == set()


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_link_leads_somewhere(page):
    text = page.read_text(encoding="utf-8")
    dead = []
    for link in re.findall(r"\]\(([^)\s]+)\)", re.sub(r"```.*?```", "", text, flags=re.S)):
        if re.match(r"[a-z]+:", link):
            continue
        name, _, anchor = link.partition("#")
        target = (page.parent / name).resolve() if name else page
        if not target.exists() or (
            anchor and target.suffix == ".md" and anchor not in anchors(target)
        ):
            dead.append(link)
    assert dead == []


def anchors(page):
    """Return the anchors of a page's headings, as GitHub makes them."""
    headings = re.findall(r"^#+ +(.*)$", page.read_text(encoding="utf-8"), re.M)
    plain = (re.sub(r"[^\w\- ]", "", heading.lower()).strip() for heading in headings)
    return {heading.replace(" ", "-") for heading in plain}
