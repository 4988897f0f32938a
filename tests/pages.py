"""The README and docs/*.md as blocks: what test_docs.py and test_worked_term.py run."""

import re
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
TERM = ROOT / "docs" / "add_term.md"  # its blocks are laid over a copy of the program


@dataclass(frozen=True)
class Block:
    """A fenced block; ``file`` is the name that the line before it ends with."""

    where: str
    language: str
    text: str
    file: str


def blocks(page: Path) -> list[Block]:
    """The fenced blocks of a page, in order."""
    text = page.read_text(encoding="utf-8")
    found = []
    for fence in re.finditer(r"^```(\w*)\n(.*?)^```$", text, re.DOTALL | re.MULTILINE):
        before = text[: fence.start()].rstrip("\n")
        named = re.search(r"`([\w./-]+\.\w+)`:$", before[before.rfind("\n\n") + 1 :])
        line = before.count("\n") + 2
        found.append(Block(f"{page.name}:{line}", fence[1], fence[2], named[1] if named else ""))
    return found


def commands(block: Block) -> list[str]:
    """The commands of a block of shell, without comments."""
    lines = block.text.replace("\\\n", " ").splitlines()
    bare = (re.sub(r"(^|\s)#.*", "", line).strip() for line in lines)
    return [line for line in bare if line]
