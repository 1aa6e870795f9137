"""What the site shows besides the pages of docs/: files of the project that pages link to, and the commands' help.

`make docs` loads this as a hook of mkdocs. A link from a page to a file outside docs/ leads to a copy of it, so the
same Markdown works in the repository and on the site.
"""

from __future__ import annotations

import re
from pathlib import Path, PurePosixPath
from typing import Any

from mkdocs.structure.files import File, Files

ROOT = Path(__file__).resolve().parent.parent
LINK = re.compile(r"(\]\()((?:\.\./)+)([^)#\s]+)")
PAGES = {"CONTRIBUTING.md": "contributing.md", "CHANGELOG.md": "changelog.md"}  # of the project, pages on the site


def on_files(files: Files, config: Any) -> Files:
    """Adds the project's own pages, the reference of the commands, and copies of the files that pages link to."""
    for source, target in PAGES.items():
        files.append(File.generated(config, target, content=_at_home((ROOT / source).read_text())))
    files.append(File.generated(config, "reference/cli.md", content=commands()))
    for page in ROOT.glob("docs/**/*.md"):
        for _, ups, target in LINK.findall(page.read_text()):
            path = (page.parent / ups / target).resolve()
            name = _name(path)
            if (
                path.is_file()
                and not path.is_relative_to(ROOT / "docs")
                and name not in PAGES.values()
                and name not in files.src_uris
            ):
                files.append(File.generated(config, name, content=path.read_bytes()))
    return files


def on_page_markdown(markdown: str, page: Any, config: Any, files: Files) -> str:
    """Turns links to files outside docs/ into links to their copies."""
    here = (ROOT / "docs" / page.file.src_uri).parent

    def copied(match: re.Match[str]) -> str:
        path = (here / match[2] / match[3]).resolve()
        if path.is_relative_to(ROOT / "docs") or not path.exists():
            return match[0]
        back = "../" * (len(PurePosixPath(page.file.src_uri).parts) - 1)
        return f"{match[1]}{back}{_name(path)}"

    return LINK.sub(copied, markdown)


def commands() -> str:
    """The help of every command, as Markdown."""
    import typer.main
    from typer.cli import get_docs_for_click

    from stadera.cli.app import app

    group = typer.main.get_group(app)
    page = get_docs_for_click(obj=group, ctx=typer.Context(group), name="stadera", title="The commands")
    for name, command in group.commands.items():  # a sentence each, which it cuts at 45 letters
        told = f"* [`{name}`](#stadera-{name}): {_sentence(command.help or '')}"
        page = re.sub(rf"(?m)^\* `{name}`: .*", told, page)
    return re.sub(r"(?m)^\* `[^`]{80,}`", lambda long: long[0].replace("|", "` | `"), page)  # else wider than a page


def _sentence(text: str) -> str:
    """The first sentence of a help, on one line."""
    return " ".join(re.split(r"(?<=\.)\s", text.strip(), maxsplit=1)[0].split())


def _name(path: Path) -> str:
    """Where a file of the project is on the site."""
    inside = path.relative_to(ROOT).as_posix()
    return PAGES.get(inside, f"files/{inside}")


def _at_home(text: str) -> str:
    """A page of the project's root as a page of docs/: its links to docs/ lose the folder, the others gain one."""
    return re.sub(
        r"(\]\()(?!https?:|#)([^)]+)",
        lambda m: m[1] + (m[2].removeprefix("docs/") if m[2].startswith("docs/") else f"../{m[2]}"),
        text,
    )
