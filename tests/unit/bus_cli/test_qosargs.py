"""The --qos-... options, and the policies that echo takes from the publishers."""

from argparse import ArgumentParser, Namespace

import pytest

from bus.errors import ConfigurationError
from bus.graph import Graph, GraphEndpoint, GraphNode
from bus.qos import Durability, History, Liveliness, QoSProfile, Reliability, sensor_data
from bus_cli.qosargs import add_qos_arguments, choose_profile, given_profile
from rows import for_each

NODE = GraphNode(id=1, name="talker", namespace="/", pid=1)


def parse(*words: str, preset: str = "sensor_data") -> Namespace:
    parser = ArgumentParser()
    add_qos_arguments(parser, "subscribe", preset)
    return parser.parse_args(words)


def graph(*offers: QoSProfile) -> Graph:
    publishers = tuple(
        GraphEndpoint(
            id=number,
            kind="publisher",
            node=NODE,
            topic="/topic",
            type_name="std_msgs/msg/String",
            type_hash="RIHS01_0",
            gid=bytes(16),
            qos=offer,
        )
        for number, offer in enumerate(offers)
    )
    return Graph(revision=1, broker_pid=1, nodes=(NODE,), publishers=publishers, subscriptions=(), matches=())


def test_without_options_it_is_the_preset() -> None:
    assert given_profile(parse()) == sensor_data
    assert given_profile(parse(preset="default")) == QoSProfile()


def test_every_option() -> None:
    args = parse(
        *("--qos-profile", "default", "--qos-depth", "3", "--qos-history", "keep_all"),
        *("--qos-reliability", "best_effort", "--qos-durability", "transient_local"),
        *("--qos-liveliness", "manual_by_topic", "--qos-liveliness-lease-duration-seconds", "2.5"),
    )
    assert given_profile(args) == QoSProfile(
        depth=3,
        history=History.KEEP_ALL,
        reliability=Reliability.BEST_EFFORT,
        durability=Durability.TRANSIENT_LOCAL,
        liveliness=Liveliness.MANUAL_BY_TOPIC,
        liveliness_lease_duration=2.5,
    )


def test_system_default_is_the_policy_of_the_default_profile() -> None:
    assert given_profile(parse("--qos-reliability", "system_default")).reliability is Reliability.RELIABLE


@pytest.mark.parametrize("words", [("--qos-depth", "0"), ("--qos-liveliness-lease-duration-seconds", "-1")])
def test_values_out_of_range(words: tuple[str, str]) -> None:
    with pytest.raises(ConfigurationError):
        given_profile(parse(*words))


@for_each("words", [("--qos-profile", "x"), ("--qos-history", "x"), ("--qos-depth", "x")])
def test_unknown_values_are_wrong_usage(words: tuple[str, str]) -> None:
    with pytest.raises(SystemExit) as caught:
        parse(*words)
    assert caught.value.code == 2


RELIABLE = QoSProfile()
BEST_EFFORT = QoSProfile(reliability="best_effort")
LASTING = QoSProfile(durability="transient_local")


@pytest.mark.parametrize(
    ("offers", "reliability", "durability"),
    [
        ((), "best_effort", "volatile"),
        ((RELIABLE,), "reliable", "volatile"),
        ((BEST_EFFORT,), "best_effort", "volatile"),
        ((RELIABLE, RELIABLE), "reliable", "volatile"),
        ((LASTING, LASTING), "reliable", "transient_local"),
    ],
)
def test_echo_asks_for_what_all_publishers_offer(
    offers: tuple[QoSProfile, ...], reliability: str, durability: str, capsys: pytest.CaptureFixture[str]
) -> None:
    chosen = choose_profile(graph(*offers), "/topic", parse())
    assert (chosen.reliability, chosen.durability, chosen.depth) == (reliability, durability, 5)
    assert capsys.readouterr().err == ""


def test_it_falls_back_with_a_word_where_publishers_differ(capsys: pytest.CaptureFixture[str]) -> None:
    chosen = choose_profile(graph(RELIABLE, BEST_EFFORT, LASTING), "/topic", parse())
    assert (chosen.reliability, chosen.durability) == ("best_effort", "volatile")
    assert capsys.readouterr().err == (
        "Some, but not all, publishers are offering QoSReliabilityPolicy.RELIABLE. Falling back to "
        "QoSReliabilityPolicy.BEST_EFFORT as it will connect to all publishers\n"
        "Some, but not all, publishers are offering QoSDurabilityPolicy.TRANSIENT_LOCAL. Falling back to "
        "QoSDurabilityPolicy.VOLATILE as it will connect to all publishers\n"
    )


@for_each(
    "words", [("--qos-profile", "sensor_data"), ("--qos-depth", "7"), ("--qos-durability", "transient_local")]
)
def test_any_option_turns_the_choice_off(words: tuple[str, str]) -> None:
    args = parse(*words)
    assert choose_profile(graph(RELIABLE), "/topic", args) == given_profile(args)
    assert given_profile(args).reliability is Reliability.BEST_EFFORT


def test_other_topics_do_not_count() -> None:
    assert choose_profile(graph(RELIABLE), "/other", parse()) == sensor_data
