"""Hook of mkdocs (`mkdocs.yml`): pages that are generated from the code, and those that stand outside docs/.

Pages of `cases`, CHANGELOG and CONTRIBUTING are taken into the site, and links that lead to them are turned there.
"""

from __future__ import annotations

import posixpath
import re
import sys
from pathlib import Path
from urllib.parse import urlsplit

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))  # mkdocs loads this file by its path

from tools.reference_pages import GENERATED  # noqa: E402
from tools.site_math import insert_equations, mark_equations  # noqa: E402

CASES = [f"cases/{path.parent.name}/README.md" for path in sorted(ROOT.glob("cases/*/README.md"))]
EQUATIONS: dict[str, dict[str, str]] = {}  # MathML by page and by the word that holds its place
SHIM = "assets/iframe-worker-shim.js"
SHIM_ON_THE_NETWORK = "https://unpkg.com/iframe-worker/shim"  # which the theme names
TAKEN_IN = ["CHANGELOG.md", "CONTRIBUTING.md", *CASES]


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add what is generated or taken in."""
    for name, make in GENERATED.items():
        files.append(File.generated(config, f"reference/{name}.md", content=make()))
    for name in TAKEN_IN:
        files.append(File.generated(config, name, content=(ROOT / name).read_text(encoding="utf-8")))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Turn links that leave docs/ to the page that was taken in and back, and set words in place of the equations."""
    uri = page.file.src_uri
    outside = uri in TAKEN_IN
    base = posixpath.dirname(uri if outside else f"docs/{uri}")

    def turned(match: re.Match[str]) -> str:
        target, anchor = match[1], match[2] or ""
        if "://" in target or target.startswith("mailto:"):
            return match[0]
        resolved = posixpath.normpath(posixpath.join(base, target))
        inside = resolved.removeprefix("docs/") if resolved.startswith("docs/") else resolved
        if outside or not resolved.startswith("docs/"):
            if files.get_file_from_path(inside) is None:
                return f"]({target}{anchor})" if resolved.startswith("docs/") else "](#)"
            return f"]({posixpath.relpath(inside, posixpath.dirname(uri) or '.')}{anchor})"
        return match[0]

    linked = re.sub(r"\]\(([^)#\s]+)(#[^)]*)?\)", turned, markdown)
    text, EQUATIONS[uri] = mark_equations(linked, uri)
    return text


def on_page_content(html: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Put the equations in, and keep the text of figures out of the search."""
    return re.sub(
        r"<svg(?=[\s>])", "<svg data-search-exclude", insert_equations(html, EQUATIONS.get(page.file.src_uri, {}))
    )


def on_post_page(output: str, page: Page, config: MkDocsConfig) -> str:
    """Load what the search needs without a server from the site, not from the network."""
    return output.replace(SHIM_ON_THE_NETWORK, posixpath.relpath(SHIM, posixpath.dirname(page.file.dest_uri) or "."))


def on_post_template(output_content: str, template_name: str, config: MkDocsConfig) -> str:
    """Do the same for pages of the theme, such as 404.html, which is shown at any address: from the site's root."""
    root = urlsplit(config.site_url or "").path or "/"
    return output_content.replace(SHIM_ON_THE_NETWORK, posixpath.join(root, SHIM))
