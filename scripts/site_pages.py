"""What mkdocs needs to make a site of pages that are written for a git host (a hook of mkdocs.yml).

The first page is the README and the last CHANGELOG.md. Links keep leading to the file that they name: to its page where
it has one, else to a copy of the file that goes into the site under ``source/``. Formulas (blocks of ``math``) become
MathML, which browsers draw without a script from elsewhere.
"""

import os
import re
from pathlib import Path, PurePosixPath
from typing import Any

from latex2mathml.converter import convert
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).parents[1]
OUTSIDE = {"README.md": "index.md", "CHANGELOG.md": "changelog.md"}  # pages that do not lie in docs/
LINK = re.compile(r"(?<=\]\()(?![a-z]+:|#)([^)#\s]+)")


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Draw the blocks of ``math``."""
    fences = config.mdx_configs.setdefault("pymdownx.superfences", {})
    fences["custom_fences"] = [{"name": "math", "class": "formula", "format": formula}]
    return config


def formula(source: str, *_: Any, **__: Any) -> str:
    """A block of TeX as MathML."""
    return f'<div class="formula">{convert(source, display="block")}</div>'


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages that lie outside docs/."""
    for name, page in OUTSIDE.items():
        files.append(File.generated(config, page, content=(ROOT / name).read_text(encoding="utf-8")))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Turn the links of one page, from paths in the repository into paths in the site."""
    home = PurePosixPath(page.file.src_uri)
    folder = "." if home.name in OUTSIDE.values() else f"docs/{home.parent}"

    def turned(link: re.Match[str]) -> str:
        target = os.path.normpath(f"{folder}/{link[1]}")
        if target in OUTSIDE:
            place = OUTSIDE[target]
        elif target.startswith("docs/"):
            place = target.removeprefix("docs/")
        else:
            place = f"source/{target}"
            if files.get_file_from_path(place) is None and (ROOT / target).is_file():
                files.append(File.generated(config, place, abs_src_path=str(ROOT / target)))
        return os.path.relpath(place, home.parent)

    return LINK.sub(turned, markdown)
