"""bus_bridge.rmw_zenoh.keys: keys, tokens and gids; the gids are those that pyzeros computes."""

from importlib.util import find_spec

import pytest

from bus.qos import QoSProfile
from bus_bridge.rmw_zenoh.keys import (
    EndpointToken,
    NodeToken,
    data_key,
    gid_of,
    parse_token,
    write_endpoint,
    write_node,
)
from rows import for_each

SESSION = "96893a62d0a24f0f8f1a2b3c4d5e6f70"
HASH = "RIHS01_abe9e4bb6b41b40e6789712c00ec8871923e089af3f667a79992a428cff2da0a"
TYPE = "std_srvs/srv/SetBool"
NODE = f"@ros2_lv/0/{SESSION}/0/0/NN/%/%/zeros"
TAIL = f"zeros/%zeros%far_set/std_srvs::srv::dds_::SetBool_/{HASH}/::,10:,:,:,,"
SERVER = f"@ros2_lv/0/{SESSION}/0/3/SS/%/%zeros/{TAIL}"
FLEET = SERVER.replace("/%zeros/", "/%a%rather%long%namespace%of%a%robot%in%a%fleet%of%many%robots/")


def test_a_key_of_data() -> None:
    assert data_key(7, "/a/b", TYPE, HASH) == f"7/a/b/std_srvs::srv::dds_::SetBool_/{HASH}"


@pytest.mark.skipif(find_spec("xxhash") is None, reason="needs the extra rmw-zenoh: make setup installs it")
@for_each(
    ("token", "gid"),
    [
        (NODE, "98fdae667b6680460396fcf232d8cb32"),
        (SERVER, "322605c52845c55cb7256ef3670ef798"),
        (FLEET, "664f074f3ff5c6710c38895232b6e8b7"),  # above 240 bytes the hash has another form
    ],
)
def test_gids(token: str, gid: str) -> None:
    assert gid_of(token).hex() == gid


def test_tokens_of_ros_2_are_read() -> None:
    node = NodeToken(SESSION, "0", "/", "zeros", is_of_busd=False)
    assert parse_token(NODE) == node
    assert parse_token(SERVER) == EndpointToken(
        node._replace(namespace="/zeros"), "SS", "/zeros/far_set", TYPE, HASH, QoSProfile()
    )


def test_further_parts_of_later_versions_are_ignored() -> None:
    assert parse_token(f"{SERVER}/more") == parse_token(SERVER)


def test_our_tokens_are_marked() -> None:
    node = NodeToken("ab12", "3", "/ns/of", "talker", is_of_busd=True)
    written = write_node(5, node, "robot-1")
    assert written == "@ros2_lv/5/ab12/3/3/NN/%busd%robot-1/%ns%of/talker"
    assert parse_token(written) == node
    token = EndpointToken(node, "MP", "/chatter", "std_msgs/msg/String", "RIHS01_00", QoSProfile(1))
    written = write_endpoint(5, token, 4, "robot-1")
    assert written == (
        "@ros2_lv/5/ab12/3/4/MP/%busd%robot-1/%ns%of/talker/%chatter/std_msgs::msg::dds_::String_/RIHS01_00/"
        "::,1:,:,:,,"
    )
    assert parse_token(written) == token


def test_nodes_of_different_sessions_numbers_and_names_have_different_keys() -> None:
    node = NodeToken("ab", "1", "/a", "b", is_of_busd=False)
    others = [
        node._replace(session="ac"),
        node._replace(number="2"),
        node._replace(namespace="/"),
        node._replace(name="c"),
    ]
    assert len({one.key for one in (node, *others)}) == 5


@for_each(
    "token",
    [
        "",
        "@ros2_lv",
        NODE.replace("@ros2_lv", "@other"),
        NODE.replace(SESSION, "XYZ"),
        NODE.replace("/0/0/NN", "/-1/0/NN"),
        NODE.replace("/%/", "//"),
        NODE.replace("NN", "XX"),
        NODE.replace("NN", "MP"),
        SERVER.replace("SS", "XX"),
        SERVER.replace("dds_", "dds"),
        SERVER.replace("::,10", "x:,10"),
        SERVER.replace("RIHS01_", "RIHS01 "),
        f"{NODE}{4096 * 'x'}",
    ],
)
def test_what_is_no_token(token: str) -> None:
    assert parse_token(token) is None
