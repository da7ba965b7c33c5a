"""The drawing that view_frames makes."""

from itertools import pairwise

import yaml

from bus_tf2.programs.view_frames import as_dot
from bus_tf2.tf2_py import BufferCore
from tf2_world import transform


def test_a_tree() -> None:
    buffer = BufferCore()
    for second in (1.0, 2.0):
        buffer.set_transform(transform("world", "robot", second), "me")
    buffer.set_transform_static(transform("robot", "arm"), "other")
    assert as_dot(yaml.safe_load(buffer.all_frames_as_yaml()), 3.5) == (
        "digraph G {\n"
        '"world" -> "robot"[label=" Broadcaster: me\\nAverage rate: 2.0\\nBuffer length: 1.0\\n'
        'Most recent transform: 2.0\\nOldest transform: 1.0\\n"];\n'
        '"robot" -> "arm"[label=" Broadcaster: other\\nAverage rate: 10000.0\\nBuffer length: 0.0\\n'
        'Most recent transform: 0.0\\nOldest transform: 0.0\\n"];\n'
        "edge [style=invis];\n"
        ' subgraph cluster_legend { style=bold; color=black; label ="view_frames Result";\n'
        '"Recorded at time: 3.5"[ shape=plaintext ] ;\n'
        '}->"world";\n'
        "}"
    )


def test_strange_names() -> None:
    """YAML and Graphviz read each name again; a terminal that shows the drawing executes none."""
    buffer = BufferCore()
    strange = [
        "a: b",
        "[",
        "it's",
        'x" -> "y',
        "ends with \\",
        "\x1b[31mred\x1b[0m\n",
        "\x9b2J\u202e",
        "1",
        "ä",
    ]
    for parent, child in pairwise(strange):
        buffer.set_transform_static(transform(parent, child), "me")
    frames = yaml.safe_load(buffer.all_frames_as_yaml())
    assert {child: frame["parent"] for child, frame in frames.items()} == {
        child: parent for parent, child in pairwise(strange)
    }
    for drawing in (as_dot(frames, 1.0), buffer._allFramesAsDot()):
        assert drawing.replace("\n", "").isprintable()
        assert r'"a: b" -> "["[label=' in drawing
        assert r'"x\" -> \"y" -> "ends with \\"[label=' in drawing
        assert r'-> "\U0000001b[31mred\U0000001b[0m\U0000000a"[label=' in drawing


def test_nothing() -> None:
    assert as_dot([], 1.0) == 'digraph G { "No tf data received" }'  # type: ignore[arg-type]
