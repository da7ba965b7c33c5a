"""`make wheels`: the packages of a release, and whether they are what they say. Not a part of `make test`."""


class Wrong(Exception):
    """A package that must not be published; the text says why."""


class Missing(Exception):
    """Something that this machine or its package index does not have; the text says what."""
