"""`bus run tf2_tools view_frames`: listens for a while, and draws the tree of frames.

Owns: the drawing (`as_dot`, pure), and the files.
"""

import argparse
import shutil
import subprocess
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import bus_ros.rclpy as rclpy
from bus_ros.rclpy.executors import SingleThreadedExecutor
from bus_ros.rclpy.node import Node
from bus_tf2.core.texts import quoted
from bus_tf2.programs.shell import begun, own_words
from bus_tf2.tf2_ros import Buffer, TransformListener
from bus_tf2.tf2_ros.transform_listener import DEFAULT_STATIC_TF_TOPIC, DEFAULT_TF_TOPIC

__all__ = ["as_dot", "main", "run"]


def main() -> int:
    return run(own_words())


def run(words: Sequence[str]) -> int:
    """Returns an exit status."""
    parser = argparse.ArgumentParser(
        prog="view_frames", description="Create a diagram of the TF frames being broadcast over ROS"
    )
    parser.add_argument(
        *("--wait-time", "-t"),
        type=float,
        default=5.0,
        help="Listen to the /tf topic for this many seconds before rendering the frame tree",
    )
    parser.add_argument("-o", "--output", help="Output filename")
    parser.add_argument("--tf_topic", default=DEFAULT_TF_TOPIC, help="Topic for dynamic transforms")
    parser.add_argument(
        "--tf_static_topic", default=DEFAULT_STATIC_TF_TOPIC, help="Topic for static transforms"
    )
    args = parser.parse_args(words)
    with begun():
        return _view(args)
    return 130


def as_dot(frames: Mapping[str, Mapping[str, Any]], now_s: float) -> str:
    """A graph for Graphviz, made of the text of `all_frames_as_yaml`."""
    if not frames:
        return 'digraph G { "No tf data received" }'
    lines = ["digraph G {"]
    root = ""
    for name, frame in frames.items():
        lines.append(
            f"{quoted(frame['parent'])} -> {quoted(str(name))}"
            f'[label=" Broadcaster: {quoted(frame["broadcaster"])[1:-1]}\\n'
            f"Average rate: {frame['rate']}\\n"
            f"Buffer length: {frame['buffer_length']}\\n"
            f"Most recent transform: {frame['most_recent_transform']}\\n"
            f'Oldest transform: {frame["oldest_transform"]}\\n"];'
        )
        if frame["parent"] not in frames:
            root = frame["parent"]
    lines += [
        "edge [style=invis];",
        ' subgraph cluster_legend { style=bold; color=black; label ="view_frames Result";',
        f'"Recorded at time: {now_s}"[ shape=plaintext ] ;',
        f"}}->{quoted(root)};",
        "}",
    ]
    return "\n".join(lines)


def _view(args: argparse.Namespace) -> int:
    import yaml

    node = Node("view_frames")
    buffer = Buffer(node=node)
    listener = TransformListener(buffer, node, tf_topic=args.tf_topic, tf_static_topic=args.tf_static_topic)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    log = node.get_logger()
    log.info(f"Listening to tf data for {args.wait_time} seconds...")
    end = time.monotonic() + args.wait_time
    while rclpy.ok() and (left_s := end - time.monotonic()) > 0:
        executor.spin_once(timeout_sec=left_s)
    listener.unregister()
    log.info("Generating graph...")
    text = buffer.all_frames_as_yaml()
    log.info(f"Result:tf2_msgs.srv.FrameGraph_Response(frame_yaml={text!r})")
    name = args.output or time.strftime("frames_%Y-%m-%d_%H.%M.%S")
    drawing, picture = Path(f"{name}.gv"), Path(f"{name}.pdf")
    try:
        drawing.write_text(as_dot(yaml.safe_load(text), node.get_clock().now().nanoseconds / 1e9))
    except OSError as error:
        log.error(f"can't write '{drawing}': {error.strerror}")
        return 1
    dot = shutil.which("dot")
    if dot is None:
        log.warning(
            f"there is no 'dot' (Debian: apt install graphviz): the graph is in {drawing}, without a picture"
        )
        return 0
    log.info(f"Exporting graph in {picture} file...")
    return subprocess.run([dot, "-Tpdf", str(drawing), "-o", str(picture)], check=False).returncode
