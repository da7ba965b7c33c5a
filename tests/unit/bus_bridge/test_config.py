"""bus_bridge.config: the tables for bridges in busd.toml, refused values, and the texts of errors."""

import re
from pathlib import Path

import pytest
from msgspec import structs

from bus.errors import ConfigurationError
from bus_bridge.config import load, merged
from bus_bridge.core.qos_rule import QosRule
from bus_bridge.core.rules import TopicRule
from bus_bridge.options import BridgeTable, Ros2Table, TlsTable, ZenohTable
from busd.config.file import BridgeTables, Config
from busd.config.file import load as load_busd
from rows import for_each


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("bridge") / "busd.toml"


def read(file: Path, text: str, kind: type[BridgeTable] = ZenohTable) -> BridgeTable:
    file.write_text(text)
    return load(file, kind)


@for_each("text", ["", "log_level = 'debug'", "[bridge]", "[bridge.ros2]\ndomain_id = 7", "[bridge.zenoh]"])
def test_what_is_not_said_is_as_without_a_file(file: Path, text: str) -> None:
    assert read(file, text) == ZenohTable()


def test_everything_can_be_set(file: Path) -> None:
    text = """
        [bridge.zenoh]
        id = "robot"
        namespace = "/bot1"
        listen = "tls/0.0.0.0:7447"
        connect = ["tls/laptop:7447", "quic/base:7447"]
        router = "tls/hub:7447"
        insecure = false
        allow = "/camera/**"
        deny = ["/secret", "/map"]
        tls = { ca = "ca.pem", certificate = "/etc/robot.pem", key = "keys/robot.key" }
        [[bridge.zenoh.topics]]
        pattern = "/camera/**"
        direction = "out"
        depth = 5
        max_rate_hz = 10
        priority = "data_low"
        transit = true
        [[bridge.zenoh.topics]]
        pattern = "/scan"
        far_name = "/front/scan"
        publisher = { reliability = "best_effort", depth = 1 }
        subscription.durability = "volatile"
        [bridge.ros2]
        domain_id = 3
        interface = "eth0"
        peers = "10.0.0.7"
        distro = "humble"
        """
    assert read(file, text) == ZenohTable(
        id="robot",
        namespace="/bot1",
        listen=("tls/0.0.0.0:7447",),
        connect=("tls/laptop:7447", "quic/base:7447"),
        router=("tls/hub:7447",),
        insecure=False,
        allow=("/camera/**",),
        deny=("/secret", "/map"),
        tls=TlsTable(
            ca=f"{file.parent}/ca.pem", certificate="/etc/robot.pem", key=f"{file.parent}/keys/robot.key"
        ),
        topics=(
            TopicRule(
                pattern="/camera/**",
                direction="out",
                depth=5,
                max_rate_hz=10.0,
                priority="data_low",
                transit=True,
            ),
            TopicRule(
                pattern="/scan",
                far_name="/front/scan",
                publisher=QosRule(reliability="best_effort", depth=1),
                subscription=QosRule(durability="volatile"),
            ),
        ),
    )
    assert load(file, Ros2Table) == Ros2Table(
        domain_id=3, interface="eth0", peers=("10.0.0.7",), distro="humble"
    )
    assert (
        structs.replace(load_busd(file), bridge=BridgeTables()) == Config()
    )  # busd itself ignores these tables


@for_each(
    ("text", "said"),
    [
        ("bridge = 5", "bridge: expected a table, got 5"),
        ("[bridge.zenho]", "unknown key 'bridge.zenho'; did you mean 'zenoh'?"),
        ("bridge.zenoh = 5", "bridge.zenoh: expected a table, got 5"),
        ("[bridge.zenoh]\nlisen = 'x'", "unknown key 'bridge.zenoh.lisen'; did you mean 'listen'?"),
        ("[bridge.zenoh]\nlisten = 1", "bridge.zenoh.listen = 1: expected `array`, got `int`"),
        (
            "[bridge.zenoh]\nallow = ['/a', 3]",
            "bridge.zenoh.allow = ['/a', 3]: expected `str`, got `int` - at `$[1]`",
        ),
        ("[bridge.zenoh]\nid = 7", "bridge.zenoh.id = 7: expected `str`, got `int`"),
        (
            "[bridge.zenoh]\ninsecure = 'yes'",
            "bridge.zenoh.insecure = 'yes': expected `bool`, got `str`",
        ),
        (
            "[bridge.zenoh.tls]\ncert = 'x'",
            "unknown key 'bridge.zenoh.tls.cert' (known: ca, certificate, key)",
        ),
        ("[bridge.zenoh]\ntls = 'x'", "bridge.zenoh.tls: expected a table, got 'x'"),
        (
            "[bridge.zenoh.topics]\npattern = '/a'",
            "bridge.zenoh.topics: expected an array of tables, each under [[bridge.zenoh.topics]]",
        ),
        ("[[bridge.zenoh.topics]]\ndepth = 5", "bridge.zenoh.topics[0]: 'pattern' is missing"),
        (
            "[[bridge.zenoh.topics]]\npattern = '/a'\nmax_rate = 5",
            "unknown key 'bridge.zenoh.topics[0].max_rate'; did you mean 'max_rate_hz'?",
        ),
        (
            "[[bridge.zenoh.topics]]\npattern = '/a'\npublisher = { reliabilty = 'reliable' }",
            "unknown key 'bridge.zenoh.topics[0].publisher.reliabilty'; did you mean 'reliability'?",
        ),
        (
            "[[bridge.zenoh.topics]]\npattern = '/a'\nsubscription = { reliability = 'best' }",
            "bridge.zenoh.topics[0].subscription.reliability = 'best': expected one of reliable, best_effort",
        ),
        (
            "[[bridge.zenoh.topics]]\npattern = '/a'\nsubscription = 'best'",
            "bridge.zenoh.topics[0].subscription: expected a table, got 'best'",
        ),
        (
            "[[bridge.zenoh.topics]]\npattern = '/a'\ndirection = 'inn'",
            "bridge.zenoh.topics[0].direction = 'inn': expected one of both, out, in, none",
        ),
        (
            "[[bridge.zenoh.topics]]\npattern = '/a'\n[[bridge.zenoh.topics]]\npattern = '/b'\ndepth = 0",
            "bridge.zenoh.topics[1].depth = 0: expected `int` >= 1",
        ),
        (
            "[[bridge.zenoh.topics]]\npattern = '/a'\nmax_rate_hz = 0",
            "bridge.zenoh.topics[0].max_rate_hz = 0: expected `float` > 0.0",
        ),
        (
            "[bridge.zenoh]\nallow = ['/a', 'b c']",
            "bridge.zenoh.allow = 'b c' can never match: a topic's full name begins with '/' "
            "(or begin with '**')",
        ),
        (
            "[bridge.zenoh]\ndeny = '/x['",
            "bridge.zenoh.deny = '/x[' can never match: '[' at position 2 is neither part of a name nor of a "
            "pattern",
        ),
        (
            "[[bridge.zenoh.topics]]\npattern = '/a'\n[[bridge.zenoh.topics]]\npattern = '/b/'",
            "bridge.zenoh.topics[1].pattern = '/b/' can never match: a topic's name has no empty part",
        ),
        (
            "[bridge.zenoh]\nconnect = 'tls/robot:0'",
            "bridge.zenoh.connect: address 'tls/robot:0' has port '0'; ports are from 1 to 65535",
        ),
    ],
)
def test_refusals(file: Path, text: str, said: str) -> None:
    with pytest.raises(ConfigurationError, match=f"^{re.escape(f'{file}: {said}')}$"):
        read(file, text)


@for_each(
    ("text", "said"),
    [
        ("domain_id = 233", "bridge.ros2.domain_id = 233: expected `int` <= 232"),
        ("distro = 'jazzy'", "bridge.ros2.distro = 'jazzy': expected one of auto, humble"),
        ("listen = 'tcp/x'", "bridge.ros2.listen: address 'tcp/x' must end with a host and a port"),
        ("port = 7447", "unknown key 'bridge.ros2.port' (known: "),
        ("rmw = 'fastrtps'", "bridge.ros2.rmw = 'fastrtps': expected one of dds, zenoh"),
        ("peer = '10.0.0.7'", "unknown key 'bridge.ros2.peer'; did you mean 'peers'?"),
        ("peers = ['localhost', '']", "bridge.ros2.peers: '' is not the address of a machine"),
        (
            "interface = 'a b'",
            "bridge.ros2.interface: 'a b' is not the name or address of a network interface",
        ),
        ("id = 'a b'", "bridge.ros2.id: the id of a bus has letters, digits"),
        ("namespace = '/a//b'", "bridge.ros2.namespace: Invalid namespace: "),
    ],
)
def test_refusals_for_ros_2(file: Path, text: str, said: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        read(file, f"[bridge.ros2]\n{text}", Ros2Table)
    assert str(caught.value).startswith(f"{file}: {said.partition(';')[0]}")


def test_busd_knows_a_table_whose_name_is_wrong(file: Path) -> None:
    file.write_text("[brigde.zenoh]")
    with pytest.raises(ConfigurationError, match=r"unknown key 'brigde'; did you mean 'bridge'\?$"):
        load_busd(file)


def test_a_missing_file(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"none\.toml: can't be read: No such file"):
        load(tmp_path / "none.toml", ZenohTable)


def test_the_command_line_adds_to_the_file_or_goes_before_it() -> None:
    file = ZenohTable(
        id="robot",
        insecure=False,
        listen=("tls/a:1",),
        deny=("/x",),
        tls=TlsTable(ca="ca.pem", key="a.key"),
    )
    flags = ZenohTable(
        id="other", listen=("tls/a:1", "tls/b:2"), connect=("tls/c:3",), tls=TlsTable(key="b.key")
    )
    assert merged(file, flags) == ZenohTable(
        id="other",
        insecure=False,
        listen=("tls/a:1", "tls/b:2"),
        connect=("tls/c:3",),
        deny=("/x",),
        tls=TlsTable(ca="ca.pem", key="b.key"),
    )
    assert merged(file, ZenohTable(router=("tls/d:4",))).router == ("tls/d:4",)
    assert merged(file, ZenohTable()) == file == merged(ZenohTable(), file)
    assert merged(file, ZenohTable(insecure=True)).insecure is True
