"""Pages of the site from outside docs/: documents of the root, and linked code."""

from __future__ import annotations

import os
import re
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
BESIDE = {
    "README.md": "index.md",
    "CONTRIBUTING.md": "contributing.md",
    "SECURITY.md": "security.md",
    "CHANGELOG.md": "changelog.md",
}
"""Documents of the root, and their pages."""
SOURCE = "source"
LINK = re.compile(r"(!?)\[((?:[^\[\]]|\[[^\]]*\])*)\]\((?!\w+:)([^)#\s]+)(#[^)\s]*)?\)")
"""A link within the repository: whether it is a picture, its text, path and anchor. The text may
contain a picture."""


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages: documents unchanged, code as one block each."""
    for name, page in BESIDE.items():
        files.append(File.generated(config, page, abs_src_path=str(ROOT / name)))
    for path in sorted({path for file in files.documentation_pages() for path in _linked(file)}):
        if path.is_file() and _page(path).startswith(SOURCE):
            content = f"# {path.name}\n\n`{path.relative_to(ROOT)}`\n\n{_block(path)}"
            files.append(File.generated(config, _page(path), content=content))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Change links to point to pages; links to folders become text."""
    del config, files
    if page.file.src_uri.startswith(SOURCE):
        return markdown
    document = Path(page.file.abs_src_path or "")

    def lead(link: re.Match[str]) -> str:
        picture, text, name, anchor = link.groups(default="")
        path = (document.parent / name).resolve()
        text = LINK.sub(lead, text)
        if path.is_dir():
            return text
        target = os.path.relpath(_page(path), Path(page.file.src_uri).parent)
        return f"{picture}[{text}]({target}{anchor})"

    return LINK.sub(lead, markdown)


def _linked(file: File) -> set[Path]:
    folder = Path(file.abs_src_path or "").parent
    return {(folder / link[3]).resolve() for link in LINK.finditer(file.content_string)}


def _page(path: Path) -> str:
    """Return the page of a file of the repository."""
    if path.is_relative_to(DOCS):
        return path.relative_to(DOCS).as_posix()
    name = path.relative_to(ROOT).as_posix() if path.is_relative_to(ROOT) else path.as_posix()
    return BESIDE.get(name, f"{SOURCE}/{name}.md")


def _block(path: Path) -> str:
    kind = {".py": "python", ".toml": "toml"}.get(path.suffix, "text")
    return f"````{kind}\n{path.read_text()}````\n"
