"""The release of busd, only defined here: packages take their version from this module.

It is a constant, because reading the installer's records takes longer than connecting.
"""

RELEASE = "0.1.0"
"""The release, in the form of a package index."""
