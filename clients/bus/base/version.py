"""Which release of busd this is. The only place that says so: packages take their version from here.

A constant, because asking the installer's records takes longer than to connect.
"""

RELEASE = "0.1.0"
"""The release, as a package index has it."""
