"""Python's state of threads that Python has not made: it lasts until the thread ends, if the core is asked
for it.
"""

import ctypes
import threading
from collections.abc import Callable

from bus import shm
from thread_states import all_states, this_state


def run_in_foreign_thread(action: Callable[[], object]) -> None:
    """Run `action` in a thread made by C, and wait until the thread has ended."""
    libc, thread = ctypes.CDLL(None), ctypes.c_ulong()
    call = ctypes.CFUNCTYPE(ctypes.c_void_p, ctypes.c_void_p)(lambda _: action() and None)
    assert libc.pthread_create(ctypes.byref(thread), None, call, None) == 0
    assert libc.pthread_join(thread, None) == 0


def run_in_thread(action: Callable[[], object]) -> None:
    thread = threading.Thread(target=action)
    thread.start()
    thread.join()


def states_of(run: Callable[[Callable[[], object]], None]) -> set[int]:
    seen, alive = set[int](), list[bool]()

    def ask() -> None:
        for _ in range(3):
            shm.native.keep_thread()
        seen.add(this_state())
        alive.append(this_state() in all_states())

    for _ in range(3):
        run(ask)
    assert alive == [True] * 3
    return seen


def test_what_is_kept_of_a_thread_goes_with_it() -> None:
    seen = states_of(run_in_foreign_thread)
    assert len(seen) == 3
    assert not seen & all_states()


def test_a_thread_that_python_has_made_ends_as_ever() -> None:
    seen = states_of(run_in_thread)
    assert len(seen) == 3
    assert not seen & all_states()
