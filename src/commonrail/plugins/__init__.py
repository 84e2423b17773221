"""Parts that ship with the package, by group (`commonrail.registry.GROUPS`) and name: ``module:object``."""

from __future__ import annotations

SHIPPED: dict[str, dict[str, str]] = {
    "results": {
        "comparison.json": "commonrail.report.comparison:RESULT",
        "sensitivity.json": "commonrail.report.sensitivity:RESULT",
        "tolerance.json": "commonrail.report.tolerance:RESULT",
        "reproduce.json": "commonrail.report.paper:RESULT",
        "family.json": "commonrail.report.family:RESULT",
        "fmu-result.json": "commonrail.report.foreign:RESULT",
        "fleet.json": "commonrail.report.fleet:RESULT",
        "result.json": "commonrail.report.build:CALIBRATION",
    },
    "studies": {
        "family": "commonrail.cli.family_run:STUDY",
        "fmu-study": "commonrail.cli.fmu_run:STUDY",
    },
    "pages": {"bench.html": "commonrail.page.build:page_of_run"},
    "inspectors": {"dcm": "commonrail.files.dcm:facts_of"},
    "after_fit": {
        "certainty": "commonrail.analysis.certainty.certify:judge",
        "prediction": "commonrail.analysis.prediction.predict:judge",
    },
}
