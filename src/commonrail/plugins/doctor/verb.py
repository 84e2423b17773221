"""commonrail doctor: what the machine is, what commonrail chose, and whether it works."""

from __future__ import annotations

from commonrail.base.hooks import duration
from commonrail.cli.console import print_json, print_rows, say
from commonrail.cli.grammar import table_verb
from commonrail.cli.options import Json

UNUSABLE = 2


@table_verb
def doctor(*, json: Json = False) -> None:
    """Look at this machine: does commonrail work well on it?

    Each line is a fact with "ok" or what to do. The exit status is 2 if commonrail cannot be used here.

    \b
    Example:
      commonrail doctor
    """
    from commonrail.plugins.doctor.run import OK, installed_plugins, usable
    from commonrail.plugins.doctor.run import doctor as examine

    say(f"looking; a simulation that is not compiled yet takes {duration()} ...")
    facts = examine()
    well = usable(facts)
    if json:
        plugins = [plugin._asdict() for plugin in installed_plugins()]
        print_json({"kind": "doctor", "usable": well, "facts": [fact._asdict() for fact in facts], "plugins": plugins})
    else:
        # what needs attention comes first
        rows = [(fact.name, fact.value, fact.verdict) for fact in facts]
        print_rows(("", "value", "verdict"), sorted(rows, key=lambda row: row[2] == OK), inputs=("value",))
    if not well:
        say("commonrail: cannot be used on this machine as it is; the lines above say what to do.")
        raise SystemExit(UNUSABLE)
