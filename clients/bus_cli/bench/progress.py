"""A progress bar on the terminal. Without a terminal, or without rich, it shows nothing."""

import sys
from types import TracebackType
from typing import Any, Self

__all__ = ["Bar"]


class Bar:
    """Shows the current step and its progress on stderr; use it with `with`."""

    def __init__(self) -> None:
        self._progress: Any = _make() if sys.stderr.isatty() else None
        self._task: Any = None
        self._label = ""

    def begin(self, label: str) -> None:
        """Start a new step at 0."""
        self._label = label
        self.show("starts", 0.0)

    def show(self, phase: str, part: float) -> None:
        """Show the progress `part`, from 0 to 1."""
        if self._progress is not None:
            self._progress.update(
                self._task, description=f"{self._label}: {phase}", completed=part, refresh=True
            )

    def __enter__(self) -> Self:
        if self._progress is not None:
            self._task = self._progress.add_task("", total=1.0)
            self._progress.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._progress is not None:
            self._progress.stop()


def _make() -> Any:
    try:
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn
    except ImportError:
        return None
    # Draw only when there is news: a drawing thread would disturb the measurement.
    columns = (TextColumn("{task.description}"), BarColumn(20), TaskProgressColumn())
    return Progress(
        *columns,
        console=Console(stderr=True),
        auto_refresh=False,
        transient=True,
        redirect_stdout=False,
        redirect_stderr=False,
    )
