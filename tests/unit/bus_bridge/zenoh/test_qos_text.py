"""QoS profiles as texts of key expressions."""

from hypothesis import given
from hypothesis import strategies as st

from bus.qos import Durability, History, Liveliness, QoSProfile, Reliability
from bus_bridge.zenoh import qos_text
from rows import for_each

_durations = st.none() | st.integers(1, 10**15).map(lambda ns: ns / 10**9)
_profiles = st.builds(
    QoSProfile,
    st.integers(1, 2**31 - 1),
    history=st.just(History.KEEP_LAST),
    reliability=st.sampled_from(Reliability),
    durability=st.sampled_from(Durability),
    deadline=_durations,
    lifespan=_durations,
    liveliness=st.sampled_from(Liveliness),
    liveliness_lease_duration=_durations,
)


@given(_profiles)
def test_reads_what_it_wrote(qos: QoSProfile) -> None:
    found = qos_text.read(qos_text.write(qos))
    assert found is not None
    assert (found.deadline_ns, found.lifespan_ns, found.lease_ns) == (
        qos.deadline_ns,
        qos.lifespan_ns,
        qos.lease_ns,
    )
    assert found == qos


def test_keep_all_has_no_depth() -> None:
    text = qos_text.write(QoSProfile(7, history="keep_all", durability="transient_local"))
    assert text == "rat"
    found = qos_text.read(text)
    assert found is not None and found.is_lossless and found.durability is Durability.TRANSIENT_LOCAL


@for_each(
    "text",
    [
        "",
        "rk10",
        "rk0v",
        "xk10v",
        "rk99999999999v",
        "rk10vd0",
        "rk10vd99999999999999999999",
        "rk\u0661v",
        "rk10v\n",
    ],
)
def test_refuses_what_is_no_profile(text: str) -> None:
    assert qos_text.read(text) is None


@given(st.text(alphabet="rbkavtdlem0123456789", max_size=40))
def test_any_text_is_a_profile_or_none(text: str) -> None:
    found = qos_text.read(text)
    assert found is None or isinstance(found, QoSProfile)
