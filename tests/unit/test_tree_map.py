"""tests/README.md: each module has a test file of its name, or a row with tests that exist."""

import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[2]
ALL = "*"
WITHOUT_TESTS = ("clients/bus/share/",)


def read_rows() -> list[tuple[str, list[str], list[str]]]:
    """Folder, modules and tests of each row."""
    _, _, table = (ROOT / "tests" / "README.md").read_text().partition("| folder | modules | tests |")
    rows = []
    for line in table.splitlines()[2:]:
        folder, modules, tests = (re.findall(r"`([^`]+)`", cell) for cell in line.strip("|").split("|"))
        rows.append((folder[0], modules, tests))
    return rows


def read_modules() -> list[str]:
    found = [
        path.relative_to(ROOT).as_posix()
        for root in ("busd", "clients")
        for path in sorted((ROOT / root).rglob("*.py"))
        if not path.name.startswith("__")
    ]
    return [module for module in found if not module.startswith(WITHOUT_TESTS)]


def has_test_of_its_name(module: str) -> bool:
    path = Path(module.removeprefix("clients/"))
    folder, name = ROOT / "tests" / "unit" / path.parent, path.stem.lstrip("_")
    return any((*folder.glob(f"test_{name}.py"), *folder.glob(f"test_{name}_*.py")))


def test_what_the_table_names_is_there() -> None:
    rows = read_rows()
    missing = [
        path
        for folder, modules, tests in rows
        for path in (folder, *(f"{folder}{one}.py" for one in modules if one != ALL), *tests)
        if not (ROOT / path).exists()
    ]
    assert missing == []
    assert all(modules and tests for _, modules, tests in rows)


def test_each_module_has_a_test_file_of_its_name_or_a_row() -> None:
    rows = read_rows()
    named = {f"{folder}{module}.py" for folder, modules, _ in rows for module in modules}
    whole = {folder for folder, modules, _ in rows if ALL in modules}
    without = [
        module
        for module in read_modules()
        if not has_test_of_its_name(module)
        and module not in named
        and f"{Path(module).parent.as_posix()}/" not in whole
    ]
    assert without == [], "name the tests that cover these modules in tests/README.md"


def test_a_row_is_needed() -> None:
    """If a module has a test file of its name, it must not be in the table."""
    needless = [
        f"{folder}{module}"
        for folder, modules, _ in read_rows()
        for module in modules
        if module != ALL and has_test_of_its_name(f"{folder}{module}.py")
    ]
    assert needless == []


def test_the_table_names_the_tests_of_mutants() -> None:
    """A test that fails for a broken line of a module covers it."""
    mutants = tomllib.loads((ROOT / "tests" / "mutants" / "mutants.toml").read_text())["mutant"]
    rows = read_rows()
    missing = []
    for mutant in mutants:
        module = mutant["file"]
        if not module.endswith(".py") or has_test_of_its_name(module):
            continue
        folder, name = f"{Path(module).parent.as_posix()}/", Path(module).stem
        of_folder = [row for row in rows if row[0] == folder]
        found = [row for row in of_folder if name in row[1]] or [row for row in of_folder if ALL in row[1]]
        named = {test for _, _, tests in found for test in tests}
        missing += [(module, test) for test in mutant["tests"] if test.partition("::")[0] not in named]
    assert missing == []
