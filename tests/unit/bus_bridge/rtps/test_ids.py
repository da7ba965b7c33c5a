"""Ids of our readers and writers."""

from bus_bridge.rtps.ids import (
    PARTICIPANT,
    PUBLICATIONS_READER,
    PUBLICATIONS_WRITER,
    SPDP_READER,
    SPDP_WRITER,
    is_reader_id,
    is_writer_id,
    reader_id,
    writer_id,
)
from rows import for_each


@for_each("number", [1, 2, 0xFFFFFF])
def test_an_id_says_what_it_belongs_to(number: int) -> None:
    reader, writer = reader_id(number), writer_id(number)
    assert len(reader) == len(writer) == 4 and reader != writer
    assert is_reader_id(reader) and not is_writer_id(reader)
    assert is_writer_id(writer) and not is_reader_id(writer)
    assert is_writer_id(bytes(12) + writer)


def test_ids_differ() -> None:
    assert len({reader_id(number) for number in range(1, 1000)}) == 999


def test_the_ids_of_discovery() -> None:
    assert all(map(is_writer_id, (SPDP_WRITER, PUBLICATIONS_WRITER)))
    assert all(map(is_reader_id, (SPDP_READER, PUBLICATIONS_READER)))
    assert not is_reader_id(PARTICIPANT) and not is_writer_id(PARTICIPANT)
