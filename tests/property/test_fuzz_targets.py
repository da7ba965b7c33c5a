"""The fuzzers' targets under hypothesis, with inputs of the corpus: changed, joined or cut."""

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from effort import examples
from fuzz.kept import CORPUS, inputs
from fuzz.targets import TARGETS
from rows import for_each

EDITS = st.lists(st.tuples(st.integers(0, 400), st.integers(0, 3), st.binary(max_size=4)), max_size=4)


def edited(data: bytes, edits: list[tuple[int, int, bytes]]) -> bytes:
    """`data` with some bytes replaced at each place."""
    for place, cut, new in edits:
        at = place % (len(data) + 1)
        data = data[:at] + new + data[at + cut :]
    return data


def changed(name: str) -> st.SearchStrategy[bytes]:
    kept = st.sampled_from(inputs(CORPUS, name))
    return st.one_of(
        st.binary(max_size=200), st.builds(edited, kept, EDITS), st.builds(bytes.__add__, kept, kept)
    )


@for_each("name", TARGETS)
def test_any_input_is_survived(name: str) -> None:
    @settings(deadline=None, max_examples=examples(40), suppress_health_check=list(HealthCheck))
    @given(changed(name))
    def survive(data: bytes) -> None:
        TARGETS[name](data)

    survive()
