"""The code blocks of the documents, for tests that run them."""

import re
import shlex
import sys
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[2]
DOCUMENTS = (
    "README.md",
    *sorted(str(path.relative_to(ROOT)) for path in (ROOT / "docs").glob("*.md")),
)


class Block(NamedTuple):
    """A block of code: the language and the name after the three backticks, and the text."""

    language: str
    name: str
    text: str


def blocks(text: str) -> list[Block]:
    """Return all blocks of a Markdown text."""
    return [Block(*found) for found in re.findall(r"^```(\w+) ?(.*)\n((?:.*\n)*?)```$", text, re.M)]


def blocks_in(document: str) -> list[Block]:
    return blocks((ROOT / document).read_text())


def block(document: str, name: str) -> str:
    """Return the text of the only block of this name."""
    (text,) = (block.text for block in blocks_in(document) if block.name == name)
    return text


def commands(text: str) -> list[list[str]]:
    """Return the commands of a block, for this clone and this environment."""
    return [as_here(line) for line in text.splitlines() if not line.startswith("#")]


def as_here(line: str) -> list[str]:
    """Return a command of a document for this clone, where `orchard` is run.py."""
    program, *words = shlex.split(line)
    assert program == "orchard", f"another spelling: {line}"
    return [sys.executable, str(ROOT / "run.py"), *words]
