from bus.types.service import service_support
from bus_bridge.core.status import SERVICE_TYPE, GetStatus, LinkState, RouteState


def test_tools_find_the_service_by_its_type() -> None:
    assert service_support(GetStatus).name == SERVICE_TYPE


def test_an_answer_travels_whole() -> None:
    answer = GetStatus.Response(
        engine="zenoh",
        bus="robot-12345678",
        links=[LinkState(address="tls/10.0.0.1:7447", state="up", bus="laptop-12345678")],
        routes=[RouteState(topic="/chatter", taken=3, sent=2, dropped={"replaced": 1})],
    )
    response = service_support(GetStatus).response
    assert response.decode(response.encode_checked(answer)) == answer
