"""Which release of busd this is; pyproject.toml says the same, and a test compares them.

A constant, because asking the installer's records takes longer than to connect.
"""

RELEASE = "0.1.0"
