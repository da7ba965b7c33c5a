"""The fuzzers' targets without a fuzzer: every input of the corpus once more, and what once made one fail."""

import pytest

from fuzz.targets import CORPUS, CRASHES, NATIVE, TARGETS, inputs

MOST_BYTES = 300_000


@pytest.mark.parametrize("name", TARGETS)
def test_what_is_kept_is_survived(name: str) -> None:
    for path in (*inputs(CORPUS, name), *inputs(CRASHES, name)):
        try:
            TARGETS[name](path.read_bytes())
        except Exception as error:
            error.add_note(f"input: {path}")
            raise


def test_the_corpus_is_small_and_all_of_it_is_used() -> None:
    """The inputs of those in C are run by `make native`."""
    for folder in (CORPUS, CRASHES):
        assert {path.name for path in folder.glob("*")} <= {*TARGETS, *NATIVE, "reader"}
    assert all(inputs(CORPUS, name) for name in (*TARGETS, *NATIVE))
    assert sum(path.stat().st_size for path in CORPUS.rglob("*")) < MOST_BYTES
