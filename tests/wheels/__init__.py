"""`make wheels`: the packages of a release, and whether they are what they say. Not a part of `make test`."""


class Wrong(Exception):
    """A package that must not be published; the text says why."""
