"""bus.logger: texts on the console cannot control the terminal, whoever wrote them."""

from bus.logger import ConsoleHandler
from rows import for_each
from unit.bus.test_logger import record

PLAIN = ConsoleHandler({"RCUTILS_CONSOLE_OUTPUT_FORMAT": "{message}"})


@for_each(
    ("text", "shown"),
    [
        ("two\n\tlines", "two\n\tlines"),
        ("\x1b]0;title\x07 \x1b[2J \x9b2J", r"\x1b]0;title\x07 \x1b[2J \x9b2J"),
        ("over\rwritten \u202egnihtemos \u2028line", r"over\rwritten \u202egnihtemos \u2028line"),
        ("\x1b[?25l \x1b[>4;2m \x1b[1A", r"\x1b[?25l \x1b[>4;2m \x1b[1A"),
    ],
)
def test_control_characters_but_newlines_and_tabs_are_escaped(text: str, shown: str) -> None:
    assert PLAIN.format(record(20, text)) == shown


@for_each(
    ("text", "shown"),
    [
        ("\x1b[31mred\x1b[0m", "\x1b[31mred\x1b[0m"),
        ("\x1b[1;4mbold\x1b[m", "\x1b[1;4mbold\x1b[m"),
        ("\x1b[38:2::1:2:3mred\x1b[0m \x07", "\x1b[38:2::1:2:3mred\x1b[0m \\x07"),
        ("\x1b[31mred", "\x1b[31mred\x1b[0m"),
        ("\x1b[31mred\x1b[0m \x1b[8mhidden", "\x1b[31mred\x1b[0m \x1b[8mhidden\x1b[0m"),
    ],
)
def test_a_program_s_own_colours_end_with_the_line(text: str, shown: str) -> None:
    assert PLAIN.format(record(20, text)) == shown


def test_names_and_places_can_not_do_it_either() -> None:
    made = record(30)
    made.name = made.pathname = made.funcName = "\x1b[2J"
    handler = ConsoleHandler({"RCUTILS_CONSOLE_OUTPUT_FORMAT": "{name} {file_name} {function_name}"})
    assert handler.format(made) == " ".join([r"\x1b[2J"] * 3)
