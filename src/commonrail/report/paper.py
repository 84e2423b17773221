"""Folder of a reproduction: its page, and its figures for print."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

from commonrail.files.atomic import replacing, writing
from commonrail.files.reproduction_folder import RECORD, read_reproduction
from commonrail.kinds.records import Record
from commonrail.report import reproduction_figures as figures
from commonrail.report.reproduction import PLATE_FOLDER, PLATES, Traces, reproduction_html
from commonrail.report.result_kind import ResultKind

NO_PLATES = (
    "figures for print (SVG, PDF) are left out, because they need matplotlib: install it with "
    "pip install 'commonrail[plates]', then `commonrail report {}` draws them"
)


def _page(record: Record, folder: Path) -> str:
    _, traces = read_reproduction(folder)
    return reproduction_html(record, traces, folder.as_posix() or "RUN", _has_plates(folder))


def draw_plates(folder: Path) -> str:
    """Draw the figures for print of a reproduction's folder, those that are missing.

    Returns
    -------
    str
        Empty, or a sentence with the extra that is to be installed.

    Raises
    ------
    InputError
        If the folder is not whole.
    OutputError
        If they cannot be written.
    """
    if _has_plates(folder):
        return ""
    if find_spec("matplotlib") is None:
        return NO_PLATES.format(folder)
    plates = folder / PLATE_FOLDER
    with RESULT.refusing_broken(folder):
        drawn = make_plates(*read_reproduction(folder))
    with writing(plates):
        plates.mkdir(exist_ok=True)
    for file, content in drawn.items():
        with replacing(plates / file, "wb") as stream:
            stream.write(content)
    return ""


def make_plates(record: Record, traces: Traces) -> dict[str, bytes]:
    """Figures 4, 5 and 6 of the paper as SVG and PDF, by the names of their files."""
    from commonrail.report.plates import COLUMN, PAGE, printed, side_by_side, single

    rates = figures.rates(record, traces)
    return printed(
        {
            "fig4": lambda: single(figures.convergence(record), (COLUMN, 66.0)),
            "fig5": lambda: single(figures.search_boxes(record), (COLUMN, 66.0)),
            "fig6": lambda: side_by_side(rates, (PAGE, 62.0 * len(rates))),
        }
    )


def _has_plates(folder: Path) -> bool:
    return all((folder / PLATE_FOLDER / f"{name}.{kind}").is_file() for name in PLATES for kind in ("svg", "pdf"))


RESULT = ResultKind(RECORD, "reproduction", "reproduce", _page, extra=draw_plates)
