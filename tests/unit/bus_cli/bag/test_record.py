"""The numbers that `bus bag record` accepts."""

from argparse import ArgumentParser

import pytest

from bus_cli.bag.record import add_arguments


@pytest.mark.parametrize("option", ["--max-bag-size", "--max-cache-size"])
def test_bytes_may_be_many(option: str) -> None:
    parser = ArgumentParser()
    add_arguments(parser)
    size = 20_000_000_000
    assert size in vars(parser.parse_args(["-a", option, str(size)])).values()
    for text in ("-1", "1.5", "", "9" * 19, "²"):
        with pytest.raises(SystemExit):
            parser.parse_args(["-a", f"{option}={text}"])
