"""commonrail verify: check the simulation against closed forms and against itself."""

from __future__ import annotations

import typer

from commonrail.cli.console import print_json, print_rows, say
from commonrail.cli.options import Json

__all__ = ["verify"]

FAILED = 1
_FIELDS = ("name", "value", "limit", "unit", "passed", "detail")


def verify(*, json: Json = False) -> None:
    """Run the verification study.

    The exit status is 1 if a check fails.

    \b
    Example:
      commonrail verify
    """
    from commonrail.analysis.verification import verify as run_checks

    say("verifying (the first use compiles the simulation, about 20 s) ...")
    checks = run_checks(progress=lambda text: say(str(text)))
    passed = all(check.passed for check in checks)
    if json:
        records = [{key: getattr(check, key) for key in _FIELDS} for check in checks]
        print_json({"kind": "verification", "passed": passed, "checks": records})
    else:
        rows = [
            (
                "passed" if check.passed else "FAILED",
                check.name,
                f"{check.value:.3g}",
                f"{check.limit:.3g}",
                check.unit,
                check.detail,
            )
            for check in checks
        ]
        print_rows(("", "check", "value", "limit", "unit", "what it compares"), rows)
    if not passed:
        failed = [check.name for check in checks if not check.passed]
        say(f"commonrail: {len(failed)} of {len(checks)} checks failed: {', '.join(failed)}.")
        raise typer.Exit(FAILED)
