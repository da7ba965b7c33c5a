"""What the programs share: printing what a call returns or raises, and waiting."""

import time


def attempt(label, call, *arguments, **keywords):
    """Print what `call` returns, or the error that it raises; returns what it returned."""
    try:
        result = call(*arguments, **keywords)
    except BaseException as error:
        print(f"{label}: {name_of(error)}: {error}")
        return None
    print(f"{label}: {result!r}")
    return result


def name_of(error):
    return type(error).__name__


def until(condition, spin=None, timeout_s=10.0):
    """Wait until `condition()`, calling `spin` meanwhile where it is given; returns whether it came."""
    end = time.monotonic() + timeout_s
    while not condition():
        if time.monotonic() > end:
            return False
        if spin is None:
            time.sleep(0.005)
        else:
            spin()
    return True
