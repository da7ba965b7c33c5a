"""`bus interface` as users run it, in the words of `ros2 interface`; and types that only exist in a file."""

import subprocess
from pathlib import Path

import pytest

import c_programs
from bus_cli.interface.c import client_folder
from bus_cli.output import CommandError
from cli import bus, start

WHEEL = """\
# A wheel.

uint8 LEFT=1
std_msgs/Header header # when
float64[<=4] speeds # rad/s

Spoke[] spokes
"""
SPOKE = "# A spoke.\nfloat32 length 0.5 # in m\n"


@pytest.fixture(autouse=True)
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A package of a workspace around the current directory; no daemon may be started."""
    monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)
    monkeypatch.delenv("BUS_INTERFACE_PATH", raising=False)
    monkeypatch.setenv("BUSD_AUTOSTART", "0")
    folder = tmp_path / "ws" / "src" / "demo"
    for name, text in {
        "package.xml": "<package><name>demo</name></package>",
        "msg/Wheel.msg": WHEEL,
        "msg/Spoke.msg": SPOKE,
        "msg/Bad.msg": "int33 x\n",
        "srv/Turn.srv": "Spoke spoke\n---\nbool done\n",
    }.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    monkeypatch.chdir(tmp_path / "ws")
    return folder


def test_show_expands_what_a_definition_names() -> None:
    assert bus("interface", "show", "demo/msg/Wheel").out == (
        "# A wheel.\n\nuint8 LEFT=1\nstd_msgs/Header header # when\n"
        "\tbuiltin_interfaces/Time stamp\n\t\tint32 sec\n\t\tuint32 nanosec\n\tstring frame_id\n"
        "float64[<=4] speeds # rad/s\n\nSpoke[] spokes\n\tfloat32 length 0.5\n"
    )
    assert bus("interface", "show", "demo/Wheel", "--no-comments").out == (
        "uint8 LEFT=1\nstd_msgs/Header header\n"
        "\tbuiltin_interfaces/Time stamp\n\t\tint32 sec\n\t\tuint32 nanosec\n\tstring frame_id\n"
        "float64[<=4] speeds\nSpoke[] spokes\n\tfloat32 length 0.5\n"
    )


def test_show_of_services_and_all_comments() -> None:
    assert (
        bus("interface", "show", "demo/srv/Turn").out == "Spoke spoke\n\tfloat32 length 0.5\n---\nbool done\n"
    )
    expected = "Spoke spoke\n\t# A spoke.\n\tfloat32 length 0.5 # in m\n---\nbool done\n"
    assert bus("interface", "show", "demo/srv/Turn", "--all-comments").out == expected
    assert (
        bus("interface", "show", "-", "--no-comments", stdin="std_msgs/msg/String\n").out == "string data\n"
    )


def test_list_has_titles_and_kinds() -> None:
    out = bus("interface", "list").out
    titles = [line for line in out.splitlines() if not line.startswith("    ")]
    assert titles == ["Messages:", "Services:", "Actions:"]
    assert "\n    demo/msg/Wheel\n" in out and "\n    std_srvs/srv/SetBool\n" in out
    services = bus("interface", "list", "-s").out.splitlines()
    assert services[0] == "Services:" and all("/srv/" in line for line in services[1:])
    actions = bus("interface", "list", "-a", "--json").out.splitlines()
    assert '{"type":"example_interfaces/action/Fibonacci","kind":"action"}' in actions


def test_packages_and_package() -> None:
    assert {"demo", "std_msgs", "turtlesim"} <= set(bus("interface", "packages").out.splitlines())
    with_actions = bus("interface", "packages", "-a").out.splitlines()
    assert "turtlesim" in with_actions and "demo" not in with_actions
    assert bus("interface", "package", "demo").out == (
        "demo/msg/Bad\ndemo/msg/Spoke\ndemo/msg/Wheel\ndemo/srv/Turn\n"
    )
    assert bus("interface", "package", "demo", "-s").out == "demo/srv/Turn\n"


def test_a_name_without_its_package() -> None:
    assert bus("interface", "show", "String").out == bus("interface", "show", "std_msgs/msg/String").out
    assert bus("interface", "show", "setbool").out == bus("interface", "show", "std_srvs/srv/SetBool").out
    assert bus("interface", "proto", "Spoke").out == '"length: 0.5\n"\n'


def test_proto_is_a_value_to_begin_with() -> None:
    assert bus("interface", "proto", "demo/msg/Spoke").out == '"length: 0.5\n"\n'
    assert bus("interface", "proto", "demo/srv/Turn", "--no-quotes").out == "spoke:\n  length: 0.5\n\n"


@pytest.mark.parametrize(
    ("words", "error"),
    [
        ("package nope", "Unknown package 'nope'\n"),
        ("show nope/msg/X", "Unknown package 'nope'\n"),
        (
            "show std_msgs/msg/Strin",
            "Could not find the interface 'std_msgs/msg/Strin'; did you mean 'std_msgs/msg/String'?\n",
        ),
        (
            "show Strng",
            "Invalid name 'Strng'. Expected three parts separated by '/'"
            "; did you mean 'std_msgs/msg/String'?\n",
        ),
        ("show Nonsense", "Invalid name 'Nonsense'. Expected three parts separated by '/'\n"),
        ("show Empty", "'Empty' may be std_msgs/msg/Empty or std_srvs/srv/Empty: write one of them\n"),
        ("show std_msg/msg/String", "Unknown package 'std_msg'; did you mean 'std_msgs'?\n"),
        ("package std_msg", "Unknown package 'std_msg'; did you mean 'std_msgs'?\n"),
        ("show std_msgs//String", "Invalid name 'std_msgs//String'. Must not contain empty parts\n"),
        ("show demo/msg/Bad", "demo/msg/Bad.msg:1: 'int33' is not a known type; did you mean 'int32'?\n"),
        ("proto demo/Bad", "demo/msg/Bad.msg:1: 'int33' is not a known type; did you mean 'int32'?\n"),
    ],
)
def test_errors(words: str, error: str) -> None:
    assert bus("interface", *words.split()) == ("", error, 1)


def test_show_of_a_message_within_itself(package: Path) -> None:
    (package / "msg/Egg.msg").write_text("Hen hen\n")
    (package / "msg/Hen.msg").write_text("Egg[] eggs\n")
    error = "demo/msg/Egg contains itself: demo/msg/Egg -> demo/msg/Hen -> demo/msg/Egg\n"
    assert bus("interface", "show", "demo/msg/Egg") == ("", error, 1)


def test_the_topic_tools_know_types_that_only_a_file_has(daemon: object) -> None:
    with start("topic", "echo", "/wheel", "demo/msg/Spoke", "--once") as echo:
        echo.error_line()  # no publisher yet
        result = bus("topic", "pub", "--once", "/wheel", "demo/msg/Spoke", "length: 2.5")
        assert result.code == 0, result.err
        assert echo.lines(2) == "length: 2.5\n---\n"
        assert echo.end().code == 0
    bad = bus("topic", "pub", "--once", "/wheel", "demo/msg/Bad", "x: 1")
    assert (bad.err, bad.code) == (
        "demo/msg/Bad.msg:1: 'int33' is not a known type; did you mean 'int32'?\n",
        1,
    )


def test_c_is_a_header() -> None:
    text = bus("interface", "c", "demo/msg/Wheel").out
    lines = text.splitlines()
    assert lines[0] == "/* demo/msg/Wheel, made by `bus interface c`. */"
    assert "    busd_float64_list speeds;" in lines
    assert "    demo__msg__Spoke__list spokes;" in lines
    assert "    m->length = 0.5;" in lines
    assert lines.index("} demo__msg__Spoke;") < lines.index("} demo__msg__Wheel;")
    assert lines[-1] == "#endif"


def test_c_prints_the_folder_of_the_client(tmp_path: Path) -> None:
    folder = Path(bus("interface", "c", "--path").out.strip())
    assert {"Makefile", "include", "src"} <= {path.name for path in folder.iterdir()}
    headers = Path(bus("interface", "cpp", "--path").out.strip()) / "include" / "busd"
    assert (headers / "busd.hpp").is_file()
    (tmp_path / "bus_c" / "c" / "include" / "busd").mkdir(parents=True)
    assert client_folder("c", tmp_path) == tmp_path / "bus_c" / "c"
    with pytest.raises(CommandError, match=f"has no client for cpp: {tmp_path}/bus_c is missing"):
        client_folder("cpp", tmp_path)


def test_c_needs_a_type_or_path() -> None:
    wrong = "name a message or a service, such as std_msgs/msg/String, or use --path\n"
    assert (bus("interface", "c").err, bus("interface", "cpp").code) == (wrong, 1)
    both = bus("interface", "c", "--path", "std_msgs/msg/String")
    assert (both.err, both.code) == ("--path has neither a type nor --output\n", 1)


def test_c_writes_a_file(tmp_path: Path) -> None:
    result = bus("interface", "c", "-o", str(tmp_path / "types"), "Spoke")
    path = tmp_path / "types" / "demo" / "msg" / "Spoke.h"
    assert (result.out, result.code) == (f"{path}\n", 0)
    assert path.read_text() == bus("interface", "c", "demo/msg/Spoke").out
    (tmp_path / "file").touch()
    result = bus("interface", "c", "-o", str(tmp_path / "file"), "Spoke")
    assert (result.code, result.out) == (1, "")
    assert result.err.startswith(f"can't write {tmp_path}/file/demo/msg/Spoke.h: ")


ODD = """\
int64 least -9223372036854775808
uint64 most 18446744073709551615
float64 never inf
float64 below -inf
string text "\u00e4 \U0001f600 \\"x\\" ??/"
bool nullptr
int32 linux
"""


USE_ODD = """
constexpr demo::msg::Odd odd;
static_assert(odd.least == INT64_MIN && odd.most == UINT64_MAX && odd.below < 0 && !odd.nullptr_);
static_assert(odd.text.size() == 15);
"""
USE_SPANS = """
static std::vector<double> numbers;
busd::span<const double> view = numbers;
std::span<const double> again = view;
static constexpr int three[] = {1, 2, 3};
constexpr busd::span<const int> ints = three;
static_assert(ints.size() == 3 && ints[2] == 3 && *ints.begin() == 1 && ints.end() - ints.data() == 3);
static_assert(!std::is_convertible_v<std::vector<int>, busd::span<const double>>);
static busd::span<int> changeable;
busd::span<const int> fixed = changeable;
static_assert(!std::is_convertible_v<busd::span<const int>, busd::span<int>>);
constexpr busd_endpoint_list endpoints = {nullptr, 0};
constexpr auto list = busd::span(endpoints);
static_assert(std::is_same_v<decltype(list), const busd::span<const busd_graph_endpoint *const>>);
static_assert(!std::is_convertible_v<busd_endpoint_list, busd::span<const double>>);
int main() { view = again; }
"""
INCLUDES = [f"-I{c_programs.ROOT / 'clients' / language / 'include'}" for language in ("c", "cpp")]


@pytest.mark.skipif(bool(c_programs.why_not() or c_programs.why_no_cpp()), reason="no gcc or g++")
def test_odd_defaults_and_reserved_names_compile(package: Path, tmp_path: Path) -> None:
    (package / "msg/Odd.msg").write_text(ODD)
    text = bus("interface", "c", "demo/msg/Odd").out
    assert r'busd_text_of("\303\244 \360\237\230\200 \042x\042 \077\077/");' in text
    (tmp_path / "odd.h").write_text(text)
    (tmp_path / "odd.hpp").write_text(bus("interface", "cpp", "demo/msg/Odd").out)
    (tmp_path / "odd.c").write_text('#include "odd.h"\nint main(void) { return 0; }\n')
    (tmp_path / "odd.cpp").write_text('#include "odd.h"\nint main() {}\n')
    (tmp_path / "odd17.cpp").write_text('#include "odd.hpp"\n' + USE_ODD)
    (tmp_path / "odd20.cpp").write_text(
        '#include <span>\n#include <vector>\n#include "odd.hpp"\n' + USE_SPANS
    )
    for compiler, name, standard in (
        ("gcc", "odd.c", "gnu11"),
        ("g++", "odd.cpp", "gnu++20"),
        ("g++", "odd17.cpp", "c++17"),
        ("g++", "odd20.cpp", "c++20"),
    ):
        options = ("-Wall", "-Wextra", "-Werror", "-fsyntax-only", *INCLUDES)
        c_programs.run(compiler, f"-std={standard}", *options, tmp_path / name)


CONSTANTS = r"""
bool YES=true
int8 LEAST_8=-128
int32 LEAST_32=-2147483648
uint32 MOST_32=4294967295
int64 LEAST=-9223372036854775808
int64 ABOVE_32=3000000000
uint64 MOST=18446744073709551615
float32 TENTH=0.1
float64 THIRD=-0.3333333333333333
byte THREE=3
char LETTER=65
string TEXT="ä \"x\" ??/"
"""
CHECKS = r"""
EQUAL(YES, true) EQUAL(LEAST_8, -128) EQUAL(LEAST_32, INT32_MIN) EQUAL(MOST_32, UINT32_MAX)
EQUAL(LEAST, INT64_MIN) EQUAL(MOST, UINT64_MAX) EQUAL(TENTH, 0.1f) EQUAL(THIRD, -0.3333333333333333)
EQUAL(THREE, 3) EQUAL(LETTER, 65)
static uint32_t most = NAME(MOST_32);
static int64_t below = -NAME(ABOVE_32);
"""
CHECKS_IN_C = r"""
#define NAME(constant) demo__msg__Constants__##constant
#define EQUAL(constant, value) _Static_assert(NAME(constant) == (value), #constant);
_Static_assert(-NAME(ABOVE_32) == -3000000000LL, "signed");
"""
CHECKS_IN_CPP = r"""
#define NAME(constant) demo::msg::Constants::constant
#define EQUAL(constant, value) static_assert(NAME(constant) == (value), #constant);
EQUAL(TEXT, std::string_view("\303\244 \"x\" \?\?/"))
static_assert(std::is_same_v<decltype(NAME(LEAST_8)), const int8_t>);
static_assert(std::is_same_v<decltype(NAME(TENTH)), const float>);
"""


@pytest.mark.skipif(bool(c_programs.why_not() or c_programs.why_no_cpp()), reason="no gcc or g++")
def test_constants_have_their_values_in_c_and_cpp(package: Path, tmp_path: Path) -> None:
    (package / "msg/Constants.msg").write_text(CONSTANTS)
    text = bus("interface", "c", "demo/msg/Constants").out
    assert r'#define demo__msg__Constants__TEXT "\303\244 \042x\042 \077\077/"' in text
    assert "#define demo__msg__Wheel__LEFT 1\n" in bus("interface", "c", "demo/msg/Wheel").out
    main = "int main(void) { return (int)most + (int)below; }\n"
    (tmp_path / "constants.c").write_text(text + CHECKS_IN_C + CHECKS + main)
    text = bus("interface", "cpp", "demo/msg/Constants").out
    (tmp_path / "constants.cpp").write_text(text + CHECKS_IN_CPP + CHECKS + main)
    for compiler, name, standard in (("gcc", "constants.c", "c11"), ("g++", "constants.cpp", "c++17")):
        options = ("-Wall", "-Wextra", "-Werror", "-fsyntax-only", *INCLUDES)
        c_programs.run(compiler, f"-std={standard}", *options, tmp_path / name)


@pytest.mark.skipif(bool(c_programs.why_no_cpp()), reason="no g++")
def test_a_constant_with_the_name_of_its_message_in_cpp(package: Path, tmp_path: Path) -> None:
    (package / "msg/LED.msg").write_text("uint8 LED=1\nuint8 OTHER=2\nuint8 number\n")
    text = bus("interface", "cpp", "demo/msg/LED").out
    checks = 'static_assert(demo::msg::LED::LED_ == 1 && demo::msg::LED::OTHER == 2, "");\n'
    (tmp_path / "led.cpp").write_text(text + checks)
    c_programs.run(
        "g++", "-std=c++17", "-Wall", "-Wextra", "-Werror", "-fsyntax-only", *INCLUDES, tmp_path / "led.cpp"
    )


def test_c_is_not_for_actions() -> None:
    result = bus("interface", "c", "example_interfaces/action/Fibonacci")
    assert result.code == 1
    assert result.err.startswith("example_interfaces/action/Fibonacci is no message and no service; ")


def test_c_is_for_services() -> None:
    lines = bus("interface", "c", "demo/srv/Turn").out.splitlines()
    assert "} demo__srv__Turn_Request;" in lines
    assert "static const busd_service_type demo__srv__Turn__service = {" in lines
    assert lines[-3:] == ["BUSD_SERVICE(demo__srv__Turn)", "", "#endif"]


def test_cpp_is_a_header_with_namespaces(tmp_path: Path) -> None:
    lines = bus("interface", "cpp", "demo/msg/Wheel").out.splitlines()
    assert lines[0] == "/* demo/msg/Wheel, made by `bus interface cpp`. */"
    assert "    busd::span<const double> speeds{};" in lines
    assert "    busd::span<const ::demo::msg::Spoke> spokes{};" in lines
    assert "    float length = 0.5;" in lines
    assert "    using Request = ::demo::srv::Turn_Request;" in bus("interface", "cpp", "demo/srv/Turn").out
    result = bus("interface", "cpp", "-o", str(tmp_path), "Spoke")
    assert (result.out, result.code) == (f"{tmp_path}/demo/msg/Spoke.hpp\n", 0)


@pytest.mark.skipif(bool(c_programs.why_not() or c_programs.why_no_cpp()), reason="no gcc or g++")
@pytest.mark.parametrize("first", ["c", "cpp"])
@pytest.mark.parametrize("second_type", ["Wheel", "Spoke"])
def test_a_source_has_a_type_in_c_or_in_cpp(tmp_path: Path, first: str, second_type: str) -> None:
    """Also a type inside of another: a Wheel has Spokes."""
    second = "cpp" if first == "c" else "c"
    texts = (
        bus("interface", first, "demo/msg/Wheel").out,
        bus("interface", second, f"demo/msg/{second_type}").out,
    )
    source = tmp_path / "both.cpp"
    for text, errors in ((texts[0] * 2, []), ("".join(texts), [f"demo/msg/{second_type}"])):
        source.write_text(text)
        command = ("g++", "-std=c++17", "-Wall", "-Werror", "-fsyntax-only", *INCLUDES, source)
        done = subprocess.run([*map(str, command)], capture_output=True, text=True, check=False)
        assert (done.returncode != 0) is bool(errors), done.stderr
        for name in errors:
            reason = f"{name} is already here for 'bus interface {first}'; a source has it for C or for C++"
            assert f'error: #error "{reason}"' in done.stderr
