"""`bus bag list`: the parts that it names exist."""

from importlib import import_module

import pytest

from bus_bag.storage import registry
from bus_cli.bag.list import _KINDS, _plugins
from bus_cli.main import run


@pytest.mark.parametrize("kind", _KINDS)
def test_each_part_can_be_imported(kind: str) -> None:
    for plugin in _plugins(kind):
        for name in (plugin.type, plugin.base_class):
            module, _, attribute = name.rpartition(".")
            assert hasattr(import_module(module), attribute) or import_module(name)


def test_storages_that_others_add(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    class Paper:
        identifier, suffix, magic = "paper", ".paper", b"paper"

        def open(self, path: object, content: object = None) -> None: ...
        def repair(self, file: object, metadata: object) -> None: ...

    monkeypatch.setattr(registry, "_storages", dict(registry._storages))
    registry.register(Paper())  # type: ignore[arg-type]
    assert run(["bag", "list", "storage"]) == 0
    assert capsys.readouterr().out == "mcap\nsqlite3\npaper\n"
    assert run(["bag", "list", "storage", "-v"]) == 0
    name = f"{Paper.__module__}.{Paper.__qualname__}"
    assert capsys.readouterr().out.endswith(
        f"name: paper\n\tfiles .paper, read only\n\ttype: {name}\n"
        "\tbase_class: bus_bag.storage.registry.Storage\n"
    )
