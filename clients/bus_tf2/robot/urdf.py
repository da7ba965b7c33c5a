"""Links and joints out of a URDF, and the place of a joint's child link.

Owns: the parts of URDF that robot_state_publisher and joint_state_publisher need: the tree, origins, axes,
limits, mimic. It ignores other parts (meshes, inertia, colours). Pure. Must not know: topics, messages.
"""

from collections.abc import Iterator
from math import cos, inf, isfinite, nan, pi, sin, sqrt
from typing import TYPE_CHECKING, Final, NamedTuple

from bus_tf2.core.rotation import Transform, Vector, composed, from_angles

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

__all__ = ["FIXED", "Joint", "Mimic", "Robot", "UrdfError", "parse"]

_KINDS: Final = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")
FIXED: Final = ("fixed", "planar")
"""Kinds of joints with a child that does not move, according to ROS 2."""


class UrdfError(ValueError):
    """A description that is none, or no tree; the text names what is wrong."""


class Mimic(NamedTuple):
    """The joint does what another one does."""

    joint: str
    multiplier: float
    offset: float


class Joint(NamedTuple):
    """`origin`: its place in the parent's coordinates. `limits`: (lower, upper), in radians or metres."""

    name: str
    kind: str
    parent: str
    child: str
    origin: Transform
    axis: Vector
    limits: tuple[float, float] | None
    soft_limits: tuple[float, float]
    """Infinite if the joint has none."""
    mimic: Mimic | None

    def pose(self, position: float) -> Transform:
        """The child's place in the parent's coordinates; without a finite position, it has no numbers."""
        if not isfinite(position):  # of a stranger's message; the sine of infinity is an error in Python
            position = nan
        x, y, z = self.axis
        moved, turned = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)
        if self.kind == "prismatic":
            moved = (x * position, y * position, z * position)
        elif self.kind in ("revolute", "continuous"):
            half = sin(position / 2)
            turned = (x * half, y * half, z * half, cos(position / 2))
        return composed(self.origin, (moved, turned))


class Robot(NamedTuple):
    """A tree of links."""

    name: str
    root: str
    links: list[str]
    joints: list[Joint]
    """In the order of the description."""


def parse(text: str) -> Robot:
    """Raises UrdfError."""
    from xml.etree import ElementTree

    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise UrdfError(f"it is no XML: {error}") from None
    if root.tag != "robot":
        raise UrdfError("Could not find the 'robot' element in the xml file")
    links = list(_names(root, "link"))
    if not links:
        raise UrdfError("No link elements found in urdf file")
    known = set(links)
    joints = []
    for name, element in zip(_names(root, "joint"), root.iterfind("joint"), strict=True):
        joint = _joint(name, element)
        for end in (joint.parent, joint.child):
            if end not in known:
                raise UrdfError(f"joint '{name}': there is no link '{end}'")
        joints.append(joint)
    return Robot(root.get("name", ""), _root(links, joints), links, joints)


def _names(root: "Element", tag: str) -> Iterator[str]:
    seen = set[str]()
    for element in root.iterfind(tag):
        name = element.get("name")
        if not name:
            raise UrdfError(f"a {tag} has no name")
        if name in seen:
            raise UrdfError(f"{tag} '{name}' is not unique.")
        seen.add(name)
        yield name


def _root(links: list[str], joints: list[Joint]) -> str:
    above: dict[str, Joint] = {}
    below: dict[str, list[str]] = {}
    for joint in joints:
        if other := above.get(joint.child):
            raise UrdfError(
                f"link '{joint.child}' is the child of two joints: '{other.name}' and '{joint.name}'"
            )
        above[joint.child] = joint
        below.setdefault(joint.parent, []).append(joint.child)
    roots = [link for link in links if link not in above]
    if len(roots) > 1:
        raise UrdfError(f"Two root links found: [{roots[0]}] and [{roots[1]}]")
    reached = roots.copy()
    for link in reached:  # the loop extends `reached`
        reached += below.get(link, ())
    if len(reached) < len(links):
        raise UrdfError("No root link found. The robot xml is not a valid tree.")
    return roots[0]


def _joint(name: str, element: "Element") -> Joint:
    kind = element.get("type", "")
    if kind not in _KINDS:
        raise UrdfError(f"joint '{name}' has no known type: '{kind}'")
    ends = [getattr(element.find(end), "attrib", {}).get("link", "") for end in ("parent", "child")]
    if not all(ends):
        raise UrdfError(f"joint '{name}' has no {'child' if ends[0] else 'parent'} link")
    axis = _vector(name, element.find("axis"), "xyz", (1.0, 0.0, 0.0))
    length = sqrt(sum(part * part for part in axis))
    if length == 0 and kind not in ("fixed", "floating"):
        raise UrdfError(f"joint '{name}': its axis is of length zero")
    origin = element.find("origin")
    place: Transform = (
        _vector(name, origin, "xyz", (0.0, 0.0, 0.0)),
        from_angles(*_vector(name, origin, "rpy", (0.0, 0.0, 0.0))),
    )
    x, y, z = axis
    direction = (x / length, y / length, z / length) if length else axis
    limit, safety, mimic = (element.find(tag) for tag in ("limit", "safety_controller", "mimic"))
    limits = None
    if kind == "continuous":
        limits = (-pi, pi)
    elif limit is not None:
        limits = (_number(name, limit, "lower", 0.0), _number(name, limit, "upper", 0.0))
    soft = (
        _number(name, safety, "soft_lower_limit", -inf),
        _number(name, safety, "soft_upper_limit", inf),
    )
    follows = None
    if mimic is not None:
        if not (other := mimic.get("joint")):
            raise UrdfError(f"joint '{name}': mimic names no joint")
        follows = Mimic(other, _number(name, mimic, "multiplier", 1.0), _number(name, mimic, "offset", 0.0))
    return Joint(name, kind, ends[0], ends[1], place, direction, limits, soft, follows)


def _vector(joint: str, element: "Element | None", key: str, default: Vector) -> Vector:
    text = None if element is None else element.get(key)
    if text is None:
        return default
    try:
        x, y, z = map(float, text.split())
    except ValueError:
        x = y = z = float("nan")
    if not all(map(isfinite, (x, y, z))):
        raise UrdfError(f"joint '{joint}': {key}='{text}' is not three numbers")
    return x, y, z


def _number(joint: str, element: "Element | None", key: str, default: float) -> float:
    text = None if element is None else element.get(key)
    if text is None:
        return default
    try:
        return float(text)
    except ValueError:
        raise UrdfError(f"joint '{joint}': {key}='{text}' is no number") from None
