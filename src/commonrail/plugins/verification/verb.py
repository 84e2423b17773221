"""commonrail lab verify: both engines against each other, closed forms and figures of another program."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated

from commonrail.base.text import number
from commonrail.cli.console import print_json, print_rows, say
from commonrail.cli.grammar import Option, table_verb
from commonrail.cli.options import Json

if TYPE_CHECKING:
    from commonrail.plugins.verification.closed_forms import Check

FAILED = 1


@table_verb
def verify(
    *,
    injector: Annotated[str, Option(help="Injector file, or a name of the catalogue.")] = "virtual-lino-2016",
    quick: Annotated[bool, Option("--quick", help="Use fewer pressures and candidates.")] = False,
    json: Json = False,
) -> None:
    """Run the verification study.

    Compares the fast engine with the reference, and both with closed forms and with figures of a program
    outside the project. Each check has a limit and a margin. The exit status is 1 if a check fails.

    \b
    Example:
      commonrail lab verify --quick
    """
    from commonrail.plugins.verification.run import verify as run_checks
    from commonrail.readers.injector import load_injector

    checks = run_checks(load_injector(injector), progress=say, quick=quick)
    failed = [check.name for check in checks if not check.passed]
    if json:
        records = [c._asdict() | {"value": number(c.value), "margin": number(c.margin)} for c in checks]
        print_json({"kind": "verification", "passed": not failed, "checks": records})
    else:
        print_rows(("", "check", "value", "limit", "unit", "margin", "what it compares"), _rows(checks))
    if failed:
        say(f"commonrail: {len(failed)} of {len(checks)} checks failed: {', '.join(failed)}.")
        raise SystemExit(FAILED)
    say(f"all {len(checks)} checks passed")


def _rows(checks: Sequence[Check]) -> list[tuple[str, ...]]:
    return [
        (
            "passed" if check.passed else "FAILED",
            check.name,
            f"{check.value:.3g}",
            f"{check.limit:.3g}",
            check.unit,
            f"{100.0 * check.margin:.0f} %",
            check.detail,
        )
        for check in checks
    ]
