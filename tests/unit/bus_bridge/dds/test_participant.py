"""cyclonedds' configuration, for each range of discovery."""

import re
from xml.etree import ElementTree

from bus_bridge.dds.options import DdsOptions
from bus_bridge.dds.participant import configuration
from bus_bridge.rtps.reach import DiscoveryRange
from rows import for_each

ETH = "10.0.0.1"


@for_each(
    ("interface", "discovery", "multicast", "peers"),
    [
        ("", "SUBNET", "false", ["127.0.0.1"]),
        ("", "LOCALHOST", "false", ["127.0.0.1"]),
        (ETH, "SUBNET", None, ["10.0.0.2"]),
        (ETH, "SYSTEM_DEFAULT", None, ["10.0.0.2"]),
        (ETH, "LOCALHOST", "false", ["10.0.0.2", ETH]),
        (ETH, "OFF", "false", []),
        ("", "OFF", "false", []),
    ],
)
def test_range(interface: str, discovery: DiscoveryRange, multicast: str | None, peers: list[str]) -> None:
    known = ("10.0.0.2",) if interface else ()
    options = DdsOptions(0, interface, known, discovery=discovery)
    tree = ElementTree.fromstring(f"<all>{configuration(options).replace('>,<', '><')}</all>")
    (found,) = tree.iter("NetworkInterface")
    assert found.get("multicast") == multicast
    assert [one.get("address") for one in tree.iter("Peer")] == peers
    assert [one.text for one in tree.iter("FragmentSize")] == ([] if interface else ["60000 B"])
    tags = [one.text for one in tree.iter("Tag")]
    assert len(tags) == (discovery == "OFF")
    assert all(re.fullmatch("busd_[0-9a-f]{16}", tag or "") for tag in tags)
    assert configuration(options, "file:///mine.xml").endswith(",file:///mine.xml")
