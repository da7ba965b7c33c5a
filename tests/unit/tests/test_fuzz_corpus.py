"""The fuzzers' targets without a fuzzer: every input of the corpus, and all inputs that once made a target
fail.
"""

import ast
from pathlib import Path

import fuzz
from fuzz.kept import CORPUS, CRASHES, inputs, keep
from fuzz.targets import NATIVE, TARGETS
from rows import for_each

MOST_BYTES = 300_000


@for_each("name", TARGETS)
def test_what_is_kept_is_survived(name: str) -> None:
    for data in (*inputs(CORPUS, name), *inputs(CRASHES, name)):
        try:
            TARGETS[name](data)
        except Exception as error:
            error.add_note(f"input: {data!r}")
            raise


def test_the_corpus_is_small_and_all_of_it_is_used() -> None:
    """`make native` runs the inputs of the targets in C."""
    for folder in (CORPUS, CRASHES):
        assert {path.stem for path in folder.glob("*")} <= {*TARGETS, *NATIVE, "reader"}
    assert all(inputs(CORPUS, name) for name in (*TARGETS, *NATIVE))
    assert sum(path.stat().st_size for path in CORPUS.rglob("*")) < MOST_BYTES


def test_fuzzers_see_all_that_targets_import() -> None:
    root = Path(__file__).parents[3]
    packages = {path.name for path in (*root.glob("clients/*"), root / "busd")}
    imported = set()
    for path in Path(fuzz.__file__).parent.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom):
                imported.add((node.module or "").split(".")[0])
            elif isinstance(node, ast.Import):
                imported |= {name.name.split(".")[0] for name in node.names}
    assert imported & packages == set(fuzz.OURS)


def test_what_is_kept_comes_back(tmp_path: Path) -> None:
    some = [b"", b"\0", b"\n", bytes(range(256)), b"ab"]
    keep(tmp_path, "frames", [*some, b"ab"])
    assert sorted(inputs(tmp_path, "frames")) == sorted(some)
    assert inputs(tmp_path, "session") == []
