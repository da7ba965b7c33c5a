"""The plugin for pytest, `hooks.py`; programs import it as `launch_testing.pytest`.

It is loaded by `-p launch_testing.pytest.hooks`.

Read first: `hooks.py`. Tests: `tests/system/test_launch_testing.py`.
"""
