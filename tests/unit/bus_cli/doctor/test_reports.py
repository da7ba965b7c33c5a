"""Reports of `bus doctor --report`: their categories and their layout."""

from bus_cli.doctor.finding import fail, ok, warn
from bus_cli.doctor.reports import Report, category_of, reports, text_of


def test_the_layout_is_that_of_ros2() -> None:
    assert (
        text_of(Report("x", "TITLE", [("a", 1), ("seven77", "b")])) == "\n   TITLE\na       : 1\nseven77 : b"
    )
    assert text_of(Report("x", "TITLE", [("a", 1), ("eight888", "b")])) == (
        "\n   TITLE\na           : 1\neight888    : b"
    )


def test_each_finding_has_reports() -> None:
    of = {report.category for report in reports("/x", None, None)}
    for finding in (ok("python", ""), warn("clock", ""), fail("socket", ""), warn("topics", "")):
        assert category_of(finding) in of
    assert category_of(ok("python", "")) == "package"
    assert category_of(warn("clock", "")) == "platform"
    assert category_of(fail("anything else", "")) == "middleware"


def test_a_choice_of_reports() -> None:
    chosen = [report.title for report in reports("/x", None, None, categories={"topic"})]
    assert chosen == ["TOPIC LIST", "QOS COMPATIBILITY LIST"]


def test_without_a_daemon() -> None:
    items = {report.title: report.items for report in reports("/x", None, None)}
    assert items["TOPIC LIST"] == [("topic", "none"), ("publisher count", 0), ("subscriber count", 0)]
    assert items["QOS COMPATIBILITY LIST"] == [
        ("compatibility status", "No publisher/subscriber pairs found")
    ]
    assert ("daemon", "not running") in items["RMW MIDDLEWARE"]
    assert ("busd", "installed=") not in items["PACKAGE VERSIONS"]
