"""bus.diagnostics.provoked: the bounds of log lines that other processes can cause."""

import logging
from collections.abc import Iterator

import pytest

from bus.diagnostics import provoked
from bus.logger import LogEntry, get_logger
from semantics import until

LOGGER = get_logger("test_provoked")
OF_ALL = get_logger("bus")


@pytest.fixture
def said() -> Iterator[list[str]]:
    """The texts given to both loggers."""
    entries: list[str] = []

    def hear(entry: LogEntry) -> None:
        is_note = entry.text.startswith("bus ") or "more lines" in entry.text
        assert entry.severity == (logging.INFO if is_note else logging.WARNING)
        entries.append(entry.text)

    for logger in (LOGGER, OF_ALL):
        logger.add_sink(hear)
    yield entries
    for logger in (LOGGER, OF_ALL):
        logger.remove_sink(hear)


async def until_told(said: list[str], text: str) -> None:
    await until(lambda: text in said)


async def test_a_flood_is_bounded_and_counted(said: list[str]) -> None:
    for number in range(16_000):
        provoked.warn(LOGGER, f"no match {number}")
    assert said == [f"no match {number}" for number in range(20)]
    await until_told(said, "15980 more warnings about other nodes were left out")
    assert len(said) == 21


async def test_notes_have_a_bound_of_their_own(said: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(provoked, "_PERIOD_S", 0.05)
    provoked.warn(LOGGER, "warning")
    for number in range(10_000):
        provoked.inform(LOGGER, f"bus \n{number}")
    assert said == ["warning", *(rf"bus \n{number}" for number in range(20))]
    await until_told(said, "9980 more lines like these were left out")


async def test_the_next_period_has_a_bound_of_its_own(
    said: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(provoked, "_PERIOD_S", 0.05)
    for _ in range(21):
        provoked.warn(LOGGER, "before")
    await until_told(said, "1 more warnings about other nodes were left out")
    provoked.warn(LOGGER, "after")
    assert said[-1] == "after"
    assert said.count("before") == 20


async def test_who_stays_within_it_is_not_counted(said: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(provoked, "_PERIOD_S", 0.01)
    provoked.warn(LOGGER, "one")
    await until_told(said, "one")
    await until(lambda: not provoked._lines)
    assert said == ["one"]


async def test_words_of_others_make_no_line_of_their_own(said: list[str]) -> None:
    provoked.warn(LOGGER, "text: \n[FATAL] [0.0] [you]: forged\x1b[2J")
    assert said == [r"text: \n[FATAL] [0.0] [you]: forged\x1b[2J"]


async def test_questions_are_bounded_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(provoked, "_PERIOD_S", 0.05)
    asked = [provoked.is_worth_asking() for _ in range(1000)]
    assert asked == [True] * 20 + [False] * 980
    await until(lambda: not provoked._questions)
    assert provoked.is_worth_asking()
