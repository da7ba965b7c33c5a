"""`Parts`: long samples in pieces, which a socket sends from where they lie."""

import ctypes
import gc
import weakref

import pytest

from bus import shm

if not shm.has_core():
    pytest.skip("needs the native core", allow_module_level=True)

Parts = shm.native.Parts
LONG = "long " * 20_000


def address(buffer: memoryview) -> int:
    """The memory of a read-only buffer."""
    library = ctypes.pythonapi
    view = (ctypes.c_byte * 128)()  # a Py_buffer: its memory comes first
    assert not library.PyObject_GetBuffer(ctypes.py_object(buffer), view, 0)
    found = ctypes.c_void_p.from_buffer(view).value
    library.PyBuffer_Release(view)
    assert found
    return found


def test_its_pieces_are_the_memory_of_their_owners() -> None:
    data = bytes(range(256)) * 300
    parts = Parts(b"head", LONG, memoryview(data)[1:])
    head, text, rest = parts.pieces
    assert (bytes(head), bytes(text), bytes(rest)) == (b"head", LONG.encode(), data[1:])
    body = id(LONG) + LONG.__sizeof__() - len(LONG) - 1
    assert address(text) == body
    assert address(rest) == address(memoryview(data)) + 1
    assert all(piece.readonly for piece in parts.pieces)


def test_as_a_buffer_it_is_whole() -> None:
    parts = Parts(b"head", LONG, b"")
    assert len(parts) == 4 + len(LONG)
    assert bytes(parts) == b"head" + LONG.encode()
    assert memoryview(parts)[2:8] == b"adlong"
    assert address(memoryview(parts)) == address(memoryview(parts)), "joined once"
    assert b"before " + parts == b"before head" + LONG.encode()  # type: ignore[operator]


def test_text_that_is_not_ascii_is_as_long_as_its_utf_8() -> None:
    parts = Parts("\N{SNOWMAN}" * 3, b"!")
    assert len(parts) == 10
    assert bytes(parts) == ("\N{SNOWMAN}" * 3).encode() + b"!"


def test_a_piece_outlives_all_but_its_owner() -> None:
    class Owner(bytes):
        pass

    owner = Owner(LONG.encode())
    seen = weakref.ref(owner) if hasattr(owner, "__weakref__") else None
    (piece,) = Parts(owner).pieces
    text = Parts("".join(["a", LONG])).pieces[0]
    del owner
    gc.collect()
    assert bytes(piece) == LONG.encode()
    assert bytes(text) == b"a" + LONG.encode()
    del piece
    gc.collect()
    assert seen is None or seen() is None


@pytest.mark.parametrize(
    ("piece", "error"),
    [(1, TypeError), ("\ud800", UnicodeEncodeError), (None, TypeError)],
    ids=["a number", "a lone surrogate", "nothing"],
)
def test_what_has_no_bytes_is_refused(piece: object, error: type[Exception]) -> None:
    with pytest.raises(error):
        Parts(b"head", piece)
    with pytest.raises(TypeError):
        Parts(piece=b"")  # type: ignore[call-arg]


@pytest.mark.parametrize("size", [0, 1, 1 << 20])
def test_a_room_can_be_written(size: int) -> None:
    room = shm.native.room(size)
    assert type(room) is bytearray
    assert len(room) == size
    room[:] = b"x" * size
    assert room.count(b"x") == size


@pytest.mark.parametrize("size", [-1, 1 << 70, "1"])
def test_a_room_that_can_not_be(size: int) -> None:
    with pytest.raises((ValueError, OverflowError, TypeError)):
        shm.native.room(size)


def test_items_of_several_bytes_are_refused_when_they_are_joined() -> None:
    parts = Parts(memoryview(bytes(80)).cast("Q"))
    with pytest.raises(TypeError, match="must consist of bytes"):
        memoryview(parts)  # type: ignore[arg-type]


def test_a_released_piece_is_an_error_when_the_pieces_are_joined() -> None:
    for index in (0, 1):
        parts = Parts(LONG, b"end")
        parts.pieces[index].release()
        for _ in range(2):
            with pytest.raises(ValueError, match="released"):
                memoryview(parts)  # type: ignore[arg-type]
