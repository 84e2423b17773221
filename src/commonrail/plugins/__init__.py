"""Parts that ship with the package, by group (`commonrail.registry.GROUPS`) and name: ``module:object``."""

from __future__ import annotations

SHIPPED: dict[str, dict[str, str]] = {
    "after_fit": {
        "certainty": "commonrail.analysis.certainty.certify:judge",
        "prediction": "commonrail.analysis.prediction.predict:judge",
    },
}
