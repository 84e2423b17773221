"""Workers of a cluster that only a test imagines: they are told apart, and may answer wrongly."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

from commonrail.workers.task import Answer, Outcome, Task, unpack


class Imagined:
    """Workers "a", "b" … in this process, which take turns.

    Parameters
    ----------
    names : str
        A letter for each.
    spoil : function (worker, task, right result) -> result
        Gives what the worker answers.
    """

    shares_files = False

    def __init__(self, names: str, spoil: Callable[[str, Task, Any], Any]) -> None:
        self.names, self.spoil = list(names), spoil
        self.given: list[tuple[Task, str]] = []
        self.done: list[str] = []

    @property
    def count(self) -> int:
        """Number of workers."""
        return len(self.names)

    @property
    def busy(self) -> bool:
        """Return whether tasks are in hand."""
        return bool(self.given)

    def submit(self, task: Task) -> bool:
        """Take a task for the worker whose turn it is."""
        if len(self.given) >= len(self.names):
            return False
        allowed = [name for name in self.names if name != task.avoid] or self.names
        self.given.append((task, allowed[len(self.done) % len(allowed)]))
        return True

    def listen(self) -> Iterator[tuple[Task, Outcome]]:
        """Do one task."""
        task, worker = self.given.pop(0)
        self.done.append(worker)
        right = unpack(task.package)(task.argument)
        yield task, Answer(self.spoil(worker, task, right), 0.01, worker)

    def others(self, worker: str) -> bool:
        """Return whether there are workers beside this one."""
        return set(self.names) > {worker}

    def dismiss(self, worker: str) -> None:
        """Use a worker no more."""
        self.names.remove(worker)
        given, self.given = self.given, []
        for task, name in given:
            self.given.append((task, self.names[0] if name == worker else name))

    def drop(self) -> None:
        """Forget the tasks in hand."""
        self.given = []

    def close(self) -> None:
        """Nothing to end."""
