"""The command as it runs where the system is not POSIX: ``python -m tests.other_systems VERB …``.

What Windows lacks of `os` and `signal`, and the modules that it lacks, are hidden from the package's own code alone:
Python and other packages have their own branch for each system. Worker processes import this module too.
"""

from __future__ import annotations

import builtins
import os
import signal
from types import ModuleType
from typing import Any

LACKING = {
    "fcntl": None,
    "grp": None,
    "pwd": None,
    "resource": None,
    "termios": None,
    "os": (
        "O_DIRECTORY O_NOFOLLOW O_NONBLOCK chown fchmod fork getegid geteuid getgid getloadavg getuid killpg mkfifo "
        "sched_getaffinity setsid statvfs sysconf uname"
    ),
    "signal": "ITIMER_PROF SIGALRM SIGHUP SIGKILL SIGPIPE SIGQUIT SIGUSR1 SIGXCPU alarm pthread_sigmask setitimer",
}


class _Less(ModuleType):
    """Module without some of its names."""

    def __init__(self, module: ModuleType, without: str) -> None:
        super().__init__(module.__name__)
        self._module, self._without = module, frozenset(without.split())

    def __getattr__(self, name: str) -> Any:
        if name in self._without:
            raise AttributeError(f"module {self._module.__name__!r} has no attribute {name!r} on Windows")
        return getattr(self._module, name)


_LESS = {module.__name__: _Less(module, str(LACKING[module.__name__])) for module in (os, signal)}
_import = builtins.__import__


def _as_elsewhere(name: str, scope: Any = None, *args: Any, **kwargs: Any) -> Any:
    if str((scope or {}).get("__name__", "")).startswith("commonrail"):
        if name in _LESS:
            return _LESS[name]
        if name in LACKING:
            raise ImportError(f"No module named {name!r} on Windows")
    return _import(name, scope, *args, **kwargs)


builtins.__import__ = _as_elsewhere

if __name__ == "__main__":
    from commonrail.cli.start import main

    main()
