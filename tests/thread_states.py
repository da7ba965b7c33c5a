"""Python's thread states: one for each thread, with a number that is never used again."""

import ctypes
import sys

_api = ctypes.pythonapi
for _name, _takes in (
    ("PyInterpreterState_Get", ()),
    ("PyInterpreterState_ThreadHead", (ctypes.c_void_p,)),
    ("PyThreadState_Next", (ctypes.c_void_p,)),
    ("PyThreadState_Get", ()),
    ("PyThreadState_GetID", (ctypes.c_void_p,)),
):
    _function = getattr(_api, _name)
    _function.argtypes = _takes
    _function.restype = ctypes.c_uint64 if _name.endswith("ID") else ctypes.c_void_p

_LONG_S = 1000.0


def this_state() -> int:
    """The number of the calling thread's state."""
    number: int = _api.PyThreadState_GetID(_api.PyThreadState_Get())
    return number


def all_states() -> set[int]:
    """The numbers of all threads' states."""
    interval_s, found = sys.getswitchinterval(), set[int]()
    sys.setswitchinterval(_LONG_S)  # otherwise another thread might run, and end the next state
    try:
        state = _api.PyInterpreterState_ThreadHead(_api.PyInterpreterState_Get())
        while state:
            found.add(_api.PyThreadState_GetID(state))
            state = _api.PyThreadState_Next(state)
    finally:
        sys.setswitchinterval(interval_s)
    return found
