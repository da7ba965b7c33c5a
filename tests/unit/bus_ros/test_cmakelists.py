"""Programs that a CMakeLists.txt installs: Python programs, compiled ones, and the places of modules."""

from pathlib import Path
from textwrap import dedent

import pytest

from bus_ros.cmakelists import Installed, read

NAME = "arm"


def installed(folder: Path, text: str) -> Installed:
    (folder / "CMakeLists.txt").write_text(f"project({NAME})\n{dedent(text)}")
    found = read(folder, NAME)
    assert found is not None
    return found


def programs(folder: Path, text: str) -> dict[str, str]:
    """The installed programs, and their places in the package."""
    found = installed(folder, text).programs
    return {name: str(path.relative_to(folder)) for name, path in found.items()}


def test_as_most_packages_have_it(tmp_path: Path) -> None:
    text = """
        cmake_minimum_required(VERSION 3.8)
        find_package(ament_cmake REQUIRED) # (an unpaired one here does no harm
        install(PROGRAMS
          scripts/talker.py
          "scripts/listener.py"
          # scripts/old.py
          DESTINATION lib/${PROJECT_NAME}
        )
        #[[ install(PROGRAMS scripts/older.py
            DESTINATION lib/${PROJECT_NAME}) ]]
        if(BUILD_TESTING AND (TRUE))
          ament_lint_auto_find_test_dependencies()
        endif()
        ament_package()
        """
    assert programs(tmp_path, text) == {
        "talker.py": "scripts/talker.py",
        "listener.py": "scripts/listener.py",
    }


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("INSTALL(PROGRAMS a.py DESTINATION lib/${PROJECT_NAME} RENAME a)", ["a"]),
        ("install(PROGRAMS a.py b DESTINATION lib/arm/)", ["a.py", "b"]),
        ("install(PROGRAMS a.py DESTINATION lib/arm/more)", ["a.py"]),
        ("install(PROGRAMS a.py DESTINATION ${CMAKE_INSTALL_PREFIX}/lib/${PROJECT_NAME})", ["a.py"]),
        ('install(PROGRAMS a.py DESTINATION "${CMAKE_INSTALL_LIBDIR}/${PROJECT_NAME}")', ["a.py"]),
        ("install(PROGRAMS ${CMAKE_CURRENT_SOURCE_DIR}/a.py DESTINATION lib/arm)", ["a.py"]),
        ("install(PROGRAMS a.py PERMISSIONS OWNER_EXECUTE DESTINATION lib/arm COMPONENT c)", ["a.py"]),
        ("set(ALL a.py b.py)\nlist(APPEND ALL c.py)\ninstall(PROGRAMS ${ALL} DESTINATION lib/arm)", None),
        ('set(ALL "a.py;b.py")\nset(ALL ${ALL} c.py)\ninstall(PROGRAMS ${ALL} DESTINATION lib/arm)', None),
        ("set(TO lib/${PROJECT_NAME} CACHE STRING doc)\ninstall(PROGRAMS a DESTINATION ${TO})", ["a"]),
        ("install(PROGRAMS a.py TYPE BIN)", []),
        ("install(PROGRAMS a.py DESTINATION bin)", []),
        ("install(PROGRAMS a.py DESTINATION lib/other)", []),
        ("install(PROGRAMS a.py DESTINATION)", []),
        ("install(FILES a.py DESTINATION lib/arm)", []),
        ("install(DIRECTORY a DESTINATION share/arm)", []),
        ("install(PROGRAMS [[a b.py]] [=[c.py]=] DESTINATION lib/arm)", ["a b.py", "c.py"]),
        (r"install(PROGRAMS a\ b.py DESTINATION lib/arm)", ["a b.py"]),
        ("install()\ninstall(PROGRAMS)\n)(\nset()\ninstall(PROGRAMS a DESTINATION lib/arm", []),
    ],
)
def test_ways_to_say_it(tmp_path: Path, text: str, names: list[str] | None) -> None:
    assert list(programs(tmp_path, text)) == (["a.py", "b.py", "c.py"] if names is None else names)


def test_globs_and_folders_below(tmp_path: Path) -> None:
    for path in ("scripts/a.py", "scripts/deep/b.py", "nodes/c.py", "nodes/CMakeLists.txt"):
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / path).write_text("install(PROGRAMS c.py DESTINATION lib/${PROJECT_NAME})")
    text = """
        file(GLOB FLAT scripts/*.py)
        file(GLOB_RECURSE DEEP RELATIVE ${CMAKE_CURRENT_SOURCE_DIR} CONFIGURE_DEPENDS scripts/deep/*.py)
        install(PROGRAMS ${FLAT} ${DEEP} DESTINATION lib/${PROJECT_NAME})
        add_subdirectory(nodes)
        add_subdirectory(not_there)
        """
    found = {"a.py": "scripts/a.py", "b.py": "scripts/deep/b.py", "c.py": "nodes/c.py"}
    assert programs(tmp_path, text) == found
    (tmp_path / "nodes/CMakeLists.txt").write_text("add_subdirectory(../nodes)")
    assert list(programs(tmp_path, text)) == ["a.py", "b.py"]


def test_what_must_be_compiled(tmp_path: Path) -> None:
    text = """
        add_executable(driver src/driver.cpp)
        install(TARGETS driver other DESTINATION lib/${PROJECT_NAME})
        install(TARGETS core LIBRARY DESTINATION lib/arm RUNTIME DESTINATION bin)
        install(TARGETS whole ARCHIVE DESTINATION lib RUNTIME DESTINATION lib/arm)
        """
    found = installed(tmp_path, text)
    assert found.programs == {} and found.compiled == {"driver", "other", "whole"}


def test_where_modules_are(tmp_path: Path) -> None:
    text = """
        ament_python_install_package(${PROJECT_NAME})
        ament_python_install_package(tools PACKAGE_DIR src/tools)
        ament_python_install_package(renamed PACKAGE_DIR src/other)
        ament_python_install_module(lib/single.py)
        """
    folders = installed(tmp_path, text).python_folders
    assert folders == (str(tmp_path), f"{tmp_path}/src", f"{tmp_path}/lib")


def test_none(tmp_path: Path) -> None:
    assert read(tmp_path, NAME) is None
