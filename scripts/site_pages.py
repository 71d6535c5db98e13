"""Pages of the documentation that lie elsewhere in the repository: a hook of MkDocs (mkdocs.yml).

README.md, CONTRIBUTING.md and CHANGELOG.md become pages, and so does each notebook: its text, its
code and its stored outputs. Of a link that leads out of docs/ the words are left.
"""

import base64
import json
import posixpath
import re
from pathlib import Path

from mkdocs.structure.files import File

ROOT = Path(__file__).parents[1]
PAGES = {
    "README.md": "index.md",
    "CONTRIBUTING.md": "contributing.md",
    "CHANGELOG.md": "changelog.md",
}


def on_files(files, config):
    """Adds the pages, and the pictures of the notebooks."""
    for source, page in PAGES.items():
        text = relinked((ROOT / source).read_text(), "..")
        files.append(File.generated(config, page, content=text))
    for notebook in sorted((ROOT / "docs" / "notebooks").glob("*.ipynb")):
        text, pictures = page_of(json.loads(notebook.read_text()), notebook.stem)
        files.append(File.generated(config, f"notebooks/{notebook.stem}.md", content=text))
        for name, picture in pictures.items():
            files.append(File.generated(config, f"notebooks/{name}", content=picture))
    return files


def on_page_markdown(markdown, page, config, files):
    """Mends the links of the pages that lie in docs/."""
    if page.file.generated_by:
        return markdown
    return relinked(markdown, posixpath.dirname(page.file.src_uri) or ".")


def relinked(text: str, folder: str) -> str:
    """The text with its relative links mended; `folder` is where the text lies, seen from docs/.

    Of a link to what lies outside docs/ and is no page, the words are left.
    """

    inside = "" if folder == ".." else folder  # a root file becomes a page in docs/ itself

    def mended(match: re.Match) -> str:
        words, target, anchor = match[1], match[2], match[3] or ""
        if re.match(r"[a-z]+:", target):
            return match[0]
        path = posixpath.normpath(posixpath.join("docs", folder, target))
        if path in PAGES:
            path = posixpath.join("docs", PAGES[path])
        if path.startswith("docs/"):
            link = posixpath.relpath(path, posixpath.join("docs", inside))
            return f"[{words}]({link}{anchor})"
        return words

    return re.sub(r"\[([^\[\]]*)\]\(([^)#\s]+)(#[^)\s]*)?\)", mended, text)


def page_of(notebook: dict, name: str) -> tuple[str, dict[str, bytes]]:
    """A notebook as Markdown, and its pictures by file name."""
    parts, pictures = [], {}
    for cell in notebook["cells"]:
        source = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            parts.append(source)
        elif cell["cell_type"] == "code":
            parts.append(f"```python\n{source}\n```")
            for output in cell["outputs"]:
                data = output.get("data", {})
                if "image/png" in data:
                    picture = f"{name}-{len(pictures)}.png"
                    pictures[picture] = base64.b64decode("".join(data["image/png"]))
                    parts.append(f"![output of the cell above]({picture})")
                elif text := "".join(data.get("text/plain", output.get("text", ()))):
                    parts.append(f"```text\n{text.rstrip()}\n```")
    link = f"[This page is a notebook.]({name}.ipynb)"
    return "\n\n".join([*parts, link]) + "\n", pictures
