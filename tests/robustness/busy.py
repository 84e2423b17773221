"""Run a command while other processes keep the machine busy: ``python tests/robustness/busy.py 6 make test``.

Exit status: that of the command.
"""

from __future__ import annotations

import subprocess
import sys

ENDLESS = "while True: pass"


def main() -> int:
    """Start as many processes as asked for, run the command, end them."""
    count, *command = sys.argv[1:]
    others = [subprocess.Popen([sys.executable, "-c", ENDLESS]) for _ in range(int(count))]
    try:
        return subprocess.run(command, check=False).returncode
    finally:
        for other in others:
            other.kill()
            other.wait()


if __name__ == "__main__":
    sys.exit(main())
