"""Parts that ship with the package, by group (`commonrail.registry.GROUPS`) and name: ``module:object``."""

from __future__ import annotations

SHIPPED: dict[str, dict[str, str]] = {
    "verbs": {  # in the order of the help
        "simulate": "commonrail.cli.simulate:simulate",
        "calibrate": "commonrail.cli.calibrate:calibrate",
        "resume": "commonrail.cli.resume:resume",
        "runs": "commonrail.cli.runs:runs",
        "validate": "commonrail.cli.validate:validate",
        "certainty": "commonrail.cli.certainty:certainty",
        "next": "commonrail.cli.next:next_",
        "predict": "commonrail.cli.predict:predict",
        "compare": "commonrail.cli.compare:compare",
        "fleet": "commonrail.cli.fleet:fleet",
        "family": "commonrail.cli.family:family",
        "adapt": "commonrail.cli.adapt:adapt",
        "sensitivity": "commonrail.cli.sensitivity:sensitivity",
        "tolerance": "commonrail.cli.tolerance:tolerance",
        "map": "commonrail.cli.map:map_",
        "sweep": "commonrail.cli.sweep:sweep",
        "inspect": "commonrail.cli.inspect:inspect",
        "features": "commonrail.cli.features:features",
        "report": "commonrail.cli.report:report",
        "export": "commonrail.cli.export:export",
        "page": "commonrail.cli.page:page",
        "verify": "commonrail.cli.verify:verify",
        "catalogue": "commonrail.cli.catalogue:catalogue",
        "new": "commonrail.cli.new:new",
        "virtual-bench": "commonrail.cli.virtual_bench:virtual_bench",
        "reproduce": "commonrail.cli.reproduce:reproduce",
        "bench": "commonrail.cli.bench:bench",
        "optimisers": "commonrail.cli.optimisers:optimisers",
        "doctor": "commonrail.cli.doctor:doctor",
    },
}
