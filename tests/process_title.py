"""The entries of this process in /proc, set as if it had been started that way (prctl(2), PR_SET_MM_MAP)."""

import ctypes
import mmap
import os
from collections.abc import Mapping, Sequence
from pathlib import Path

_PR_SET_MM, _PR_SET_MM_MAP = 35, 14
_NO_FILE = 0xFFFFFFFF
_FIELDS = {
    "start_code": 26,
    "end_code": 27,
    "start_data": 45,
    "end_data": 46,
    "start_brk": 47,
    "brk": 0,
    "start_stack": 28,
    "arg_start": 48,
    "arg_end": 49,
    "env_start": 50,
    "env_end": 51,
    "auxv": 0,
}
"""The fields of the kernel's struct prctl_mm_map, and the position of each in /proc/self/stat."""


class _Map(ctypes.Structure):
    _fields_ = (
        *((name, ctypes.c_uint64) for name in _FIELDS),
        ("auxv_size", ctypes.c_uint32),
        ("exe_fd", ctypes.c_uint32),
    )


_kept: list[mmap.mmap] = []


def set_title(words: Sequence[str], environment: Mapping[str, str]) -> bool:
    """Set /proc/self/cmdline and environ; False if the kernel can't."""
    arguments = b"".join(os.fsencode(word) + b"\0" for word in words)
    variables = b"".join(os.fsencode(f"{name}={value}") + b"\0" for name, value in environment.items())
    text = arguments + variables
    block = mmap.mmap(-1, len(text), flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)  # it shows no other memory
    block.write(text)
    start = ctypes.addressof(ctypes.c_char.from_buffer(block))
    libc = ctypes.CDLL(None)
    libc.sbrk.restype = ctypes.c_void_p
    stat = Path("/proc/self/stat").read_text().rpartition(")")[2].split()
    found = {name: int(stat[field - 3]) for name, field in _FIELDS.items() if field}
    found["brk"] = libc.sbrk(ctypes.c_long(0))
    found["arg_start"] = start
    found["arg_end"] = found["env_start"] = start + len(arguments)
    found["env_end"] = start + len(text)
    new = _Map(**found, exe_fd=_NO_FILE)
    _kept.append(block)
    return not libc.prctl(
        _PR_SET_MM, _PR_SET_MM_MAP, ctypes.byref(new), ctypes.c_ulong(ctypes.sizeof(new)), 0
    )
