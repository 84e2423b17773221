"""Page beside the report of a run: its title and the best values of the parameters."""

import html
import json
from pathlib import Path


def page(run: Path) -> str:
    """Page of a run folder, which `commonrail report RUN --page` writes there."""
    record = json.loads((run / "result.json").read_text(encoding="utf-8"))
    rows = "".join(f"<tr><td>{html.escape(p['name'])}<td>{p['best']:.6g}" for p in record["parameters"])
    return f"<!DOCTYPE html><title>Summary</title><h1>{html.escape(record['title'])}</h1><table>{rows}</table>"
