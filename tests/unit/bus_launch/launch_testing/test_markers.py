"""bus_launch.launch_testing.markers: decorators of tests."""

import pytest

from bus_launch.launch_testing import post_shutdown_test
from bus_launch.launch_testing.markers import retry_on_failure


def test_a_post_shutdown_test_is_a_class() -> None:
    with pytest.raises(TypeError, match="decorates classes of tests"):
        post_shutdown_test()(print)  # type: ignore[arg-type]


def test_attempts() -> None:
    calls: list[int] = []

    @retry_on_failure(times=3)
    def fail_twice(self: object) -> str:
        calls.append(1)
        assert len(calls) == 3
        return "done"

    assert fail_twice(None) == "done"
    with pytest.raises(AssertionError):
        fail_twice(None)
    assert len(calls) == 6
    with pytest.raises(ValueError, match="times must be at least 1"):
        retry_on_failure(times=0)
