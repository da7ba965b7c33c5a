"""docs/c.md: its steps, and its programs; the C client's conformance; the header for C++."""

import os
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

import bus
import c_programs
from bus.base.version import RELEASE
from bus.msg.std_msgs import String
from bus_cli.doctor.conformance.program import outcome
from bus_cli.doctor.conformance.stories import STORIES
from bus_cli.interface.c import client_folder
from conftest import SOON_S
from programs import on_one_loop, running_command
from semantics import KEEP_ALL, node
from setup_functions import load_setup

pytestmark = pytest.mark.landing

__all__ = ["node"]

PAGE = (c_programs.ROOT / "docs" / "c.md").read_text()
C_PROGRAM, C_IMAGE, C_SERVICE, C_GRAPH = re.findall(r"```c\n(.*?)```", PAGE, re.DOTALL)
CMAKE_PROJECT, CMAKE_SUBDIRECTORY = re.findall(r"```cmake\n(.*?)```", PAGE, re.DOTALL)
CPP_PROGRAM, CPP_SERVICE, CPP_GRAPH = re.findall(r"```cpp\n(.*?)```", PAGE, re.DOTALL)


@pytest.fixture(scope="session")
def programs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return c_programs.build_once(tmp_path_factory)


@on_one_loop
async def test_it_passes_every_story(programs: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("BUSD_AUTOSTART", "0")
    peer, service = str(programs / "peer"), str(programs / "service")
    relay = [peer, "relay", "/conformance/in", "/conformance/out"]
    others = {
        "window": [peer, "talk", "/topic", "1000", "keep_all", "pause_ms=50"],
        "serve": [service, "serve", "/add"],
        "call": [service, "call", "/add", "1", "2", "3"],
    }
    outcomes = {story: (await outcome(story, others.get(story, relay), SOON_S))[:2] for story in STORIES}
    assert {mark for mark, _ in outcomes.values()} == {"ok"}, outcomes
    assert outcomes["real"][1] == "3 samples returned by shm and shm; the same after a kill of busd"
    assert outcomes["growth"][1] == "5 samples returned by shm and shm; texts of up to 1000000 bytes"


async def test_the_examples(node: bus.Node, programs: Path, tmp_path: Path, route: str) -> None:
    """clients/c/examples: one talks to the other, and a node of the library hears it."""
    subscription = await node.create_subscription(String, "/chatter", 10)
    async with (
        running_command(tmp_path, programs / "listener", "/chatter") as listener,
        running_command(tmp_path, programs / "talker", "/chatter") as talker,
    ):
        text = (await subscription.receive())[0].data
        await listener.line(r"Hello World: \d+")
        assert text.startswith("Hello World: ")
        for program in (talker, listener):
            program.process.send_signal(signal.SIGTERM)
            assert await program.end() == 0, program.lines


@pytest.fixture(scope="session")
def prefix(programs: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The client of a wheel, installed as the page says."""
    assert 'make -C "$(bus interface c --path)" install PREFIX=' in PAGE
    assert "make -C clients/c install PREFIX=" in PAGE
    folder = tmp_path_factory.mktemp("installed")
    for name in load_setup()["c_client"]():
        (folder / "bus_c" / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(c_programs.ROOT / "clients" / name, folder / "bus_c" / name)
    cache = f"XDG_CACHE_HOME={folder / 'cache'}"
    made = ("env", cache, "make", "-s", "-C", client_folder("c", folder), "-j2", "CFLAGS=-O0")
    c_programs.run(*made, "library")  # without the prefix
    relative = subprocess.run(
        [*made, "PREFIX=busd-c", "install"], capture_output=True, text=True, check=False
    )
    wrong = "PREFIX is 'busd-c'; it must be an absolute path, such as $HOME/busd-c\n"
    assert relative.returncode != 0 and relative.stderr.startswith(wrong)
    c_programs.run(*made, f"PREFIX={folder / 'busd-c'}", "install")
    assert (folder / "cache/busd" / f"c-{RELEASE}" / "libbusd.a").exists()
    return folder / "busd-c"


async def test_the_page_in_its_steps(node: bus.Node, prefix: Path, tmp_path: Path) -> None:
    """The program of the page, with the installed client."""
    types = tmp_path / "types"
    assert "bus interface c --output types std_msgs/msg/String" in PAGE
    written = c_programs.run(
        sys.executable, "-m", "bus_cli", "interface", "c", "--output", types, "std_msgs/msg/String"
    )
    assert written == f"{types}/std_msgs/msg/String.h\n"
    source, program = tmp_path / "hello.c", tmp_path / "hello"
    source.write_text(C_PROGRAM)
    package = (prefix / "lib/pkgconfig/busd.pc").read_text()
    assert package.startswith(f"prefix={prefix}\n")
    flags = re.findall(r"^(?:Cflags|Libs): (.*)", package, re.MULTILINE)
    assert flags == ["-L${libdir} -lbusd", "-I${includedir}"]
    c_programs.run(
        "gcc",
        "-Wall",
        "-Wextra",
        "-Werror",
        f"-I{types}",
        f"-I{prefix}/include",
        source,
        f"-L{prefix}/lib",
        "-lbusd",
        "-o",
        program,
    )
    subscription = await node.create_subscription(String, "/out", 10)
    publisher = await node.create_publisher(String, "/in", 10)
    async with running_command(tmp_path, program, LD_LIBRARY_PATH=f"{prefix}/lib") as hello:
        assert (await subscription.receive())[0].data == "hello from C"
        await publisher.wait_for_subscriptions()
        publisher.publish(String(data="hello from the shell"))
        await hello.line("I heard: hello from the shell")
        hello.process.send_signal(signal.SIGINT)
        assert await hello.end() == -signal.SIGINT


def test_the_functions_of_the_page_compile(programs: Path, tmp_path: Path) -> None:
    source = tmp_path / "image.c"
    headers = ("sensor_msgs/msg/Image", "example_interfaces/srv/AddTwoInts")
    includes = [f'#include "{header}.h"' for header in headers]
    source.write_text("\n".join(["#include <stdio.h>", *includes, C_IMAGE, C_SERVICE, C_GRAPH]))
    c_programs.compile_c(programs, source, tmp_path / "image.o", "-c", "-Wno-unused-function")


CPP_MAIN = """
int main(int argc, char **)
{
    if (argc == 1)
        return hello();
    busd::bus bus("adder");
    busd::node node = bus.create_node("adder");
    const auto server = serve(node);
    std::printf("sum %d\\n", int(add(bus, node, 2, 3)));
    std::printf("answers: %s\\n", publishers_of(bus, "/add/_reply").c_str());
}
"""


@pytest.fixture(scope="session")
def cpp_page(programs: Path, prefix: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The programs of the page in C++, as one. The page's project for CMake builds it; without cmake, g++."""
    folder = tmp_path_factory.mktemp("cpp")
    assert "int main()" in CPP_PROGRAM
    text = CPP_PROGRAM.replace("int main()", "int hello()") + CPP_SERVICE + CPP_GRAPH + CPP_MAIN
    (folder / "hello.cpp").write_text(text)
    if shutil.which("cmake") is None:
        includes = (f"-I{prefix / 'include'}", f"-I{programs / 'types'}")
        libraries = (f"-L{prefix / 'lib'}", "-lbusd", f"-Wl,-rpath,{prefix / 'lib'}")
        c_programs.run(
            "g++", "-std=c++17", *includes, folder / "hello.cpp", *libraries, "-o", folder / "hello"
        )
        return folder / "hello"
    project = CMAKE_PROJECT.replace("busd REQUIRED", f"busd {RELEASE} REQUIRED")
    project = project.replace("msg/String)", "msg/String example_interfaces/srv/AddTwoInts)")
    newer = "find_package(busd 99 QUIET)\nif(busd_FOUND)\n  message(FATAL_ERROR 99)\nendif()\n"
    (folder / "CMakeLists.txt").write_text(project + newer)
    write_bus(folder)
    given = (f"-DCMAKE_PREFIX_PATH={prefix}", f"-DBUSD_BUS={folder}/bus", "-DCMAKE_CXX_FLAGS=-Wall -Werror")
    c_programs.run("cmake", "-S", folder, "-B", folder / "build", *given)
    c_programs.run("cmake", "--build", folder / "build")
    return folder / "build/hello"


def write_bus(folder: Path) -> None:
    """A program `bus` of this checkout."""
    (folder / "bus").write_text(f'#!/bin/sh\nexec {sys.executable} -m bus_cli "$@"\n')
    (folder / "bus").chmod(0o755)


async def says_hello(node: bus.Node, program: Path, folder: Path) -> None:
    """The first program of the page hears a message, and publishes it."""
    subscription = await node.create_subscription(String, "/out", 10)
    publisher = await node.create_publisher(String, "/in", 10)
    async with running_command(folder, program) as hello:
        await publisher.wait_for_subscriptions()
        await subscription.wait_for_publishers()
        publisher.publish(String(data="hello from the shell"))
        assert (await subscription.receive())[0].data == "I heard: hello from the shell"
        hello.process.send_signal(signal.SIGINT)
        assert await hello.end() == -signal.SIGINT


@pytest.mark.skipif(shutil.which("cmake") is None or bool(c_programs.why_no_cpp()), reason="no cmake or g++")
async def test_a_project_that_builds_the_client(
    node: bus.Node, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    project, build = tmp_path / "project", tmp_path / "build"
    project.mkdir()
    (project / "hello.cpp").write_text(CPP_PROGRAM)
    (project / "CMakeLists.txt").write_text(CMAKE_SUBDIRECTORY)
    write_bus(tmp_path)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=os.pathsep)
    strict = "-Wall -Wextra -Werror"
    c_programs.run(
        *("cmake", "-S", project, "-B", build, f"-DCMAKE_C_FLAGS={strict}", f"-DCMAKE_CXX_FLAGS={strict}")
    )
    c_programs.run("cmake", "--build", build)
    await says_hello(node, build / "hello", tmp_path)


@pytest.mark.skipif(bool(c_programs.why_no_cpp()), reason=c_programs.why_no_cpp())
async def test_the_programs_in_cpp(node: bus.Node, cpp_page: Path, tmp_path: Path) -> None:
    await says_hello(node, cpp_page, tmp_path)
    async with running_command(tmp_path, cpp_page, "add") as adder:
        assert await adder.end() == 0
        assert adder.lines == ["sum 5", "answers: /adder "]


@pytest.mark.skipif(bool(c_programs.why_no_cpp()), reason=c_programs.why_no_cpp())
async def test_the_header_for_cpp(node: bus.Node, programs: Path, tmp_path: Path, route: str) -> None:
    from bus.msg.geometry_msgs import PoseArray

    subscription = await node.create_subscription(PoseArray, "/cpp/out", KEEP_ALL)
    publisher = await node.create_publisher(String, "/cpp/in", KEEP_ALL)
    async with c_programs.peer(programs, tmp_path, "cpp") as cpp:
        await cpp.line("refused 22: Invalid topic name")
        await publisher.wait_for_subscriptions()
        for frame in ("map", "base"):
            await publisher.send(String(data=frame))
            got = (await subscription.receive())[0]
            assert (got.header.frame_id, len(got.poses), got.poses[2].position.x) == (frame, 3, 2.0)
            await cpp.line(f"^{frame} 3 poses, x 2, w 1$")
        cpp.program.process.send_signal(signal.SIGTERM)
        assert await cpp.program.end() == 0
    assert cpp.program.lines[-1] == "taken 2, published 2"
    assert cpp.program.lines.count("destroyed in its callback") == 1
