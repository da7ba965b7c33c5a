"""bus.base.loading: a Ctrl-C during an import takes effect after the import, and prints no traceback of
it.
"""

import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from bus.base.loading import deferred_interrupts

SIGNAL_AT = """
import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)
def trace(frame, event, argument):
    code = frame.f_code
    if event == "call" and code.co_name == {function!r} and code.co_filename.endswith({file!r}):
        sys.settrace(None)
        signal.raise_signal(signal.SIGINT)
        {at_last}
sys.settrace(trace)
"""


def ended(program: str, folder: Path) -> tuple[int, str, str]:
    """Exit status and both outputs of `program`, run from its own file."""
    path = folder / "program.py"
    path.write_text(program)
    done = subprocess.run([sys.executable, str(path)], capture_output=True, text=True, timeout=60)
    return done.returncode, done.stdout, done.stderr


@pytest.fixture(autouse=True)
def default_handler() -> Iterator[None]:
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


class TestDeferredInterrupts:
    def test_it_comes_at_the_end(self) -> None:
        steps = []
        with pytest.raises(KeyboardInterrupt), deferred_interrupts():
            signal.raise_signal(signal.SIGINT)
            steps.append("went on")
        assert steps == ["went on"]
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler

    def test_an_inner_block_leaves_it_to_the_outer_one(self) -> None:
        steps = []
        with pytest.raises(KeyboardInterrupt), deferred_interrupts():
            with deferred_interrupts():
                signal.raise_signal(signal.SIGINT)
            steps.append("after the inner one")
        assert steps == ["after the inner one"]

    def test_without_a_signal_nothing_happens(self) -> None:
        with deferred_interrupts():
            pass
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler

    def test_an_error_of_the_module_goes_through(self) -> None:
        with pytest.raises(ImportError), deferred_interrupts():
            raise ImportError
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler

    def test_the_handler_of_a_program_stays(self) -> None:
        came: list[int] = []
        signal.signal(signal.SIGINT, lambda number, _: came.append(number))
        with deferred_interrupts():
            signal.raise_signal(signal.SIGINT)
            assert came == [signal.SIGINT]

    def test_a_handler_that_a_module_sets_stays(self) -> None:
        with deferred_interrupts():
            signal.signal(signal.SIGINT, signal.SIG_IGN)
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN

    def test_no_effect_in_another_thread(self) -> None:
        seen: list[object] = []

        def look() -> None:
            with deferred_interrupts():
                seen.append(signal.getsignal(signal.SIGINT))

        thread = threading.Thread(target=look)
        thread.start()
        thread.join()
        assert seen == [signal.default_int_handler]


class TestImports:
    def test_python_drops_no_interrupt(self, tmp_path: Path) -> None:
        """In the callback `cb`, CPython only prints "ignored" for a KeyboardInterrupt, and continues."""
        program = (
            "import bus\n"
            + SIGNAL_AT.format(function="cb", file="importlib._bootstrap>", at_last="")
            + "bus.Node\nprint('runs on')\n"
        )
        assert ended(program, tmp_path) == (-signal.SIGINT, "", "")

    def test_a_signal_just_before_the_first_line(self, tmp_path: Path) -> None:
        """Python raises KeyboardInterrupt at the end of the call that blocks SIGINT."""
        program = (
            "import _signal, signal\n"
            "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
            "block = _signal.pthread_sigmask\n"
            "def interrupted(*arguments):\n"
            "    block(*arguments)\n"
            "    _signal.pthread_sigmask = block\n"
            "    raise KeyboardInterrupt\n"
            "_signal.pthread_sigmask = interrupted\n"
            "import bus\nprint('runs on')\n"
        )
        assert ended(program, tmp_path) == (-signal.SIGINT, "", "")

    def test_msgspec_finds_datetime_loaded(self, tmp_path: Path) -> None:
        """busd loads datetime first. Otherwise msgspec's core loads it, and ignores a KeyboardInterrupt
        during that import.
        """
        program = (
            SIGNAL_AT.format(function="time", file="/datetime.py", at_last="raise KeyboardInterrupt")
            + "import bus\nfrom bus.msg.std_msgs import String\nprint('runs on')\n"
        )
        if sys.version_info >= (3, 12):
            pytest.skip("datetime.py holds no classes there")
        status, out, _ = ended(program, tmp_path)
        assert (status, out) == (-signal.SIGINT, "")

    @pytest.mark.parametrize(
        "module", ["bus.testing", "bus_actions.client", "bus_ros.rclpy", "bus_tf2.tf2_ros", "busd.run"]
    )
    def test_whichever_module_is_first(self, module: str) -> None:
        program = (
            "import sys\n"
            "class Finder:\n"
            "  def find_spec(name, path=None, target=None):\n"
            "    if name == 'msgspec': print('datetime' in sys.modules)\n"
            f"sys.meta_path.insert(0, Finder)\nimport {module}"
        )
        done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60)
        assert (done.stdout, done.stderr) == ("True\n", "")

    def test_a_message_package_shows_no_traceback(self, tmp_path: Path) -> None:
        program = (
            SIGNAL_AT.format(function="<module>", file="/bus/msg/std_msgs.py", at_last="")
            + "import bus\nfrom bus.msg.std_msgs import String\nprint('runs on')\n"
        )
        assert ended(program, tmp_path) == (-signal.SIGINT, "", "")

    def test_the_call_that_imports_shows_no_traceback(self, tmp_path: Path) -> None:
        program = (
            "import bus\n"
            + SIGNAL_AT.format(function="_import", file="/bus/__init__.py", at_last="")
            + "bus.Node\nprint('runs on')\n"
        )
        assert ended(program, tmp_path) == (-signal.SIGINT, "", "")

    def test_the_program_may_catch_it(self, tmp_path: Path) -> None:
        program = (
            SIGNAL_AT.format(function="<module>", file="/bus/runner.py", at_last="")
            + "import bus\ntry: bus.run\nexcept KeyboardInterrupt: print('bye')\n"
        )
        assert ended(program, tmp_path) == (0, "bye\n", "")

    def test_others_have_their_traceback(self, tmp_path: Path) -> None:
        """An interrupt in the program's own code prints a traceback, as usual in Python."""
        status, _, said = ended(
            "import bus, signal\nsignal.signal(signal.SIGINT, signal.default_int_handler)\n"
            "bus.run\nsignal.raise_signal(signal.SIGINT)\n",
            tmp_path,
        )
        assert status == -signal.SIGINT
        assert said.startswith("Traceback")

    def test_a_hook_of_the_program_stays(self, tmp_path: Path) -> None:
        program = "import sys\nsys.excepthook = lambda *_: print('mine')\nimport bus\nraise ValueError\n"
        assert ended(program, tmp_path) == (1, "mine\n", "")
