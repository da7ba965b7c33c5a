"""Common functions of the programs: print the result or error of a call, and wait."""

import time


def attempt(label, call, *arguments, **keywords):
    """Print the result of `call`, or the error that it raises; returns the result."""
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
    """Wait until `condition()` is true, and call `spin`, if given, meanwhile; returns whether it is."""
    end = time.monotonic() + timeout_s
    while not condition():
        if time.monotonic() > end:
            return False
        if spin is None:
            time.sleep(0.005)
        else:
            spin()
    return True
