"""Run the notebooks of the documentation and keep their outputs: ``python -m tools.notebooks [NOTEBOOK ...]``."""

from __future__ import annotations

import re
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import nbclient
import nbformat

DOCS = Path(__file__).resolve().parents[1] / "docs"
NOTEBOOKS = sorted([*DOCS.glob("tutorials/*.ipynb"), *DOCS.glob("notebooks/*.ipynb")])


def run_notebook(path: Path, timeout: float = 1200) -> Any:
    """Run a notebook in its own folder and return it with its outputs; a cell that raises ends it."""
    notebook = nbformat.read(path, as_version=4)
    resources = {"metadata": {"path": str(path.parent)}}
    nbclient.NotebookClient(notebook, timeout=timeout, kernel_name="python3", resources=resources).execute()
    return notebook


def strip_run_details(notebook: Any) -> Any:
    """Remove details that differ between runs: times of execution, overwritten progress, a temporary folder."""
    for cell in notebook.cells:
        cell.metadata.pop("execution", None)
        if cell.cell_type == "code":
            cell.outputs = [o for o in cell.outputs if not (o.output_type == "stream" and o.name == "stderr")]
            for output in cell.outputs:
                if output.output_type == "stream":  # paths relative to the folder
                    output.text = re.sub(rf"{re.escape(tempfile.gettempdir())}/tmp\w+/", "", output.text)
    return notebook


def main() -> None:
    """Run the notebooks that the command line names, or all."""
    for path in map(Path, sys.argv[1:]) if sys.argv[1:] else NOTEBOOKS:
        begin = time.perf_counter()
        nbformat.write(strip_run_details(run_notebook(path.resolve())), path)
        print(f"{path}: {time.perf_counter() - begin:.0f} s, {path.stat().st_size / 1e3:.0f} kB", flush=True)


if __name__ == "__main__":
    main()
