"""Fuzzing: targets, each a function of bytes, and the programs that run them. See docs/reliability.md.

make fuzz SECONDS=60                     all of them, guided by coverage (atheris; clang for the C parts)
make test                                every input of the corpus once more, and hypothesis
"""

OURS = ("bus", "bus_bridge", "bus_cli", "bus_ros", "busd")
"""Packages in which a Python fuzzer sees the steps: all packages that targets import."""
