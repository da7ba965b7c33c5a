"""The count finds exactly the sentences that a reader may have to read twice."""

import pytest

import wording


@pytest.mark.parametrize(
    ("sentence", "sign"),
    [
        ("What busd drops it also counts.", "what ... as a noun"),
        ("It waits where there is no room.", "where for if"),
        ("The process who publishes waits for room.", "who for a program"),
        ("It keeps those that have not been sent.", "those that"),
        ("Nothing is sent but for the history.", "old words"),
        ("Each node has a queue of its own here.", "of its own"),
        ("Of the publisher this is the depth.", "no subject"),
        ("It says, that the depth is too large.", "comma before that"),
        (" ".join(["word"] * 33), "long"),
    ],
)
def test_each_sign_is_found(sentence: str, sign: str) -> None:
    assert wording.signs(sentence) == [sign]


@pytest.mark.parametrize(
    "sentence",
    [
        "If there is no room, the publisher waits.",
        "busd counts every message that it drops.",
        " ".join(["word"] * 32),
    ],
)
def test_a_plain_sentence_has_no_sign(sentence: str) -> None:
    assert wording.signs(sentence) == []


def test_a_sentence_ends_before_the_name_of_a_program_too() -> None:
    assert wording.sentences("The queue is full now. busd drops the oldest message.") == [
        "The queue is full now.",
        "busd drops the oldest message.",
    ]


def test_a_page_is_read_by_cells_and_items_without_its_code() -> None:
    page = (
        "A first `line` of text.\n\n```sh\nnot a word of this\n```\n\n"
        "- an item of a list\n\n| one cell of a row | [a link of a row](x.md) |\n"
    )
    found = [(line, text.strip()) for line, text in wording.of_page(page) if len(text.split()) > 2]
    assert found == [
        (1, "A first line of text."),
        (7, "- an item of a list"),
        (9, "one cell of a row"),
        (9, "a link of a row"),
    ]


def test_docstrings_and_comments_are_read_and_no_other_text() -> None:
    source = '"""A module that does this."""\n\nname = "a text that users see"  # a comment beside it\n'
    assert list(wording.of_source(source)) == [(1, "A module that does this."), (3, "a comment beside it")]
