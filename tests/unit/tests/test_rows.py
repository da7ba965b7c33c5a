"""Tables of values in one case: every row is tested, and each failing row is named."""

import pytest

from rows import for_each


def test_every_row_is_tried_and_each_that_fails_is_named() -> None:
    tried = []

    @for_each(("left", "right"), [(1, "a"), (2, "b"), (3, "c"), (4, "d")])
    def table(left: int, right: str) -> None:
        tried.append((left, right))
        assert left % 2
        with pytest.raises(ValueError):
            int("1" if left == 3 else "")

    with pytest.raises(AssertionError) as caught:
        table()
    assert tried == [(1, "a"), (2, "b"), (3, "c"), (4, "d")]
    row, third, fourth = caught.value.__notes__
    assert row == "in the row left=2, right='b'"
    assert third == "fails too: left=3, right='c': Failed: DID NOT RAISE ValueError"
    assert fourth.startswith("fails too: left=4, right='d': AssertionError: ")


def test_two_tables_make_every_pair() -> None:
    tried = []

    @for_each("left", [1, 2])
    @for_each("right", "ab")
    def table(left: int, right: str) -> None:
        tried.append((left, right))
        assert (left, right) != (2, "a")

    with pytest.raises(AssertionError) as caught:
        table()
    assert tried == [(1, "a"), (1, "b"), (2, "a"), (2, "b")]
    assert caught.value.__notes__ == ["in the row right='a'", "in the row left=2"]


@for_each("number", [1, 2])
def test_fixtures_come_beside_the_row(number: int, capsys: pytest.CaptureFixture[str]) -> None:
    print(number)
    assert capsys.readouterr().out == f"{number}\n"


def test_a_row_cannot_be_skipped_nor_a_table_be_empty() -> None:
    @for_each("row", [1])
    def skipping(row: int) -> None:
        pytest.skip("not here")

    with pytest.raises(TypeError, match="row=1 would leave out the rows behind it"):
        skipping()
    with pytest.raises(AssertionError, match="without rows"):
        for_each("row", [])


def test_a_function_for_the_rows_is_called_when_the_test_runs() -> None:
    rows: list[int] = []
    seen: list[int] = []

    @for_each("number", lambda: rows)
    def check(number: int) -> None:
        seen.append(number)

    rows += [1, 2]
    check()
    assert seen == [1, 2]
