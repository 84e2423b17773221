"""Run the attacks and print which promises held: ``python -m tests.robustness.attack [--short] [WORD ...]``."""

from __future__ import annotations

import argparse
import signal
import sys
import tempfile
from pathlib import Path

from tests.robustness.attack import cache, cluster, files, journals, races
from tests.robustness.attack.base import ATTACKS, Attack

__all__ = ["cache", "cluster", "files", "journals", "main", "races", "verdict"]


def main() -> None:
    """Run the attacks whose name holds all the words; exit status 1 if any fell, 2 if there is none to run."""
    parser = argparse.ArgumentParser(description="Attack what docs/reliability.md promises.")
    parser.add_argument("words", nargs="*", help="only attacks whose name holds these words")
    parser.add_argument("--short", action="store_true", help="few repetitions")
    options = parser.parse_args()
    signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored when started in the background, by children too
    named = [one for one in ATTACKS if all(word in one.name for word in options.words)]
    chosen = [one for one in named if one.few or not options.short]
    if not chosen:
        names = "".join(f"\n  {one.name}" for one in ATTACKS)
        parser.error(f"no attack to run has a name with all of {options.words}; they are:{names}")
    fallen = 0
    for one in chosen:
        said = verdict(one, options.short)
        fallen += said != ""
        print(f"{'fell' if said else 'held'}  {one.name}{': ' * bool(said)}{said}", flush=True)
    print(f"{len(chosen) - fallen} of {len(chosen)} held")
    sys.exit(1 if fallen else 0)


def verdict(one: Attack, short: bool) -> str:
    """Description of what fell, "" where the promise held."""
    with tempfile.TemporaryDirectory(prefix="commonrail-attack-") as folder:
        return one.run(Path(folder), one.few if short else one.times)


if __name__ == "__main__":
    main()
