"""Parts that ship with the package, by group (`commonrail.base.registry.GROUPS`) and name: ``module:object``."""

from __future__ import annotations

# Groups whose shipped parts are in lists of the core, with their names.
ELSEWHERE = {
    "features": "commonrail.data.features.table:FEATURES",
    "fuels": "commonrail.readers.fuel:shipped_fuels",
    "injectors": "commonrail.readers.injector.file:shipped_injectors",
    "optimisers": "commonrail.calibration.optimisers.registry:shipped_methods",
    "readers": "commonrail.readers.tables:ENDINGS",
}
SHIPPED: dict[str, dict[str, str]] = {
    "data": {  # in the order of an objective, a report and its tables
        "rate": "commonrail.data.curves.data:RateData",
        "quantities": "commonrail.data.quantities.data:QuantityData",
        "return quantities": "commonrail.data.quantities.returned:ReturnData",
        "features": "commonrail.data.feature_targets.data:FeatureData",
    },
    "optimisers": {"multi-start least squares": "commonrail.plugins.multistart.run:REGISTERED"},
    "results": {
        "comparison.json": "commonrail.plugins.compare.page:RESULT",
        "sensitivity.json": "commonrail.plugins.sensitivity.page:RESULT",
        "tolerance.json": "commonrail.plugins.tolerance.page:RESULT",
        "reproduce.json": "commonrail.plugins.paper.page:RESULT",
        "family.json": "commonrail.plugins.family.page:RESULT",
        "fmu-result.json": "commonrail.plugins.foreign_fmu.page:RESULT",
        "fleet.json": "commonrail.plugins.fleet.page:RESULT",
        "result.json": "commonrail.report.page:CALIBRATION",
    },
    "studies": {
        "family": "commonrail.plugins.family.verb:STUDY",
        "fmu-study": "commonrail.plugins.foreign_fmu.verb:STUDY",
    },
    "study_keys": {"type": "commonrail.plugins.family.injector_type:with_type"},
    "pages": {"bench.html": "commonrail.plugins.page.page:page_of_run"},
    "inspectors": {"dcm": "commonrail.plugins.maps.dcm:facts_of"},
    "after_fit": {
        "certainty": "commonrail.plugins.certainty.run:judge",
        "prediction": "commonrail.plugins.prediction.run:judge",
    },
    "verbs": {  # in the order of the help
        "simulate": "commonrail.cli.verbs.simulate:simulate",
        "calibrate": "commonrail.cli.verbs.calibrate:calibrate",
        "resume": "commonrail.cli.verbs.calibrate:resume",
        "runs": "commonrail.cli.verbs.runs:runs",
        "validate": "commonrail.cli.verbs.validate:validate",
        "certainty": "commonrail.plugins.certainty.verb:certainty",
        "next": "commonrail.plugins.next.verb:next_",
        "predict": "commonrail.plugins.prediction.verb:predict",
        "compare": "commonrail.plugins.compare.verb:compare",
        "fleet": "commonrail.plugins.fleet.verb:fleet",
        "family": "commonrail.plugins.family.verb:family",
        "adapt": "commonrail.plugins.family.adapt_verb:adapt",
        "sensitivity": "commonrail.plugins.sensitivity.verb:sensitivity",
        "tolerance": "commonrail.plugins.tolerance.verb:tolerance",
        "map": "commonrail.plugins.maps.verb:map_",
        "sweep": "commonrail.plugins.maps.sweep_verb:sweep",
        "inspect": "commonrail.cli.verbs.inspect:inspect",
        "features": "commonrail.plugins.features.verb:features",
        "report": "commonrail.cli.verbs.report:report",
        "export": "commonrail.plugins.export.verb:export",
        "page": "commonrail.plugins.page.verb:page",
        "verify": "commonrail.plugins.verification.verb:verify",
        "catalogue": "commonrail.plugins.catalogue.verb:catalogue",
        "new": "commonrail.plugins.new.verb:new",
        "virtual-bench": "commonrail.plugins.paper.bench_verb:virtual_bench",
        "reproduce": "commonrail.plugins.paper.verb:reproduce",
        "doctor": "commonrail.plugins.doctor.verb:doctor",
    },
}
