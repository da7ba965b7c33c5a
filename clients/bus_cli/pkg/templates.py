"""The texts of a new package: makes contents of files from values. Pure: must not touch the file system.

The texts have the same form as in ROS 2. So the steps of lessons work (put the dependencies after the
license, fill in `console_scripts`).
"""

from typing import NamedTuple
from xml.sax.saxutils import escape, quoteattr

__all__ = ["LINTERS", "Description", "linter_test", "node", "package_xml", "setup_cfg", "setup_py"]

LINTERS = ("copyright", "flake8", "pep257")
"""ROS 2's linters for Python; a new package has a test for each."""

_PACKAGE_XML = """\
<?xml version="1.0"?>
<?xml-model href="http://download.ros.org/schema/package_format{format}.xsd" \
schematypens="http://www.w3.org/2001/XMLSchema"?>
<package format="{format}">
  <name>{name}</name>
  <version>0.0.0</version>
  <description>{description}</description>
  <maintainer email={email}>{maintainer}</maintainer>
  <license>{license}</license>

{dependencies}{test_dependencies}
  <export>
    <build_type>ament_python</build_type>
  </export>
</package>
"""

_SETUP_PY = """\
from setuptools import find_packages, setup

package_name = {name!r}

setup(
    name=package_name,
    version='0.0.0',
    packages=find_packages(exclude=['test']),
    data_files=[
        ('share/ament_index/resource_index/packages',
            ['resource/' + package_name]),
        ('share/' + package_name, ['package.xml']),
    ],
    install_requires=['setuptools'],
    zip_safe=True,
    maintainer={maintainer!r},
    maintainer_email={email!r},
    description={description!r},
    license={license!r},
    extras_require={{
        'test': [
            'pytest',
        ],
    }},
    entry_points={{
        'console_scripts': [
{scripts}        ],
    }},
)
"""

# Both commands put programs into the folder in which `ros2 run` looks for them.
_SETUP_CFG = """\
[develop]
script_dir=$base/lib/{name}
[install]
install_scripts=$base/lib/{name}
"""

_NODE = """\
def main():
    print('Hi from {name}.')


if __name__ == '__main__':
    main()
"""

_LINTER_TEST = """\
import pytest

linter = pytest.importorskip('ament_{linter}.main', reason='ament_{linter} comes with ROS 2')


def test_{linter}():
    assert linter.main(argv=['.', 'test']) == 0, 'Found errors'
"""


class Description(NamedTuple):
    """The metadata of a new package."""

    name: str
    description: str
    maintainer: str
    email: str
    license: str
    dependencies: tuple[str, ...] = ()
    node: str | None = None
    format: int = 3


def package_xml(package: Description) -> str:
    needs = "".join(f"  <depend>{escape(name)}</depend>\n" for name in package.dependencies)
    tests = [*(f"ament_{linter}" for linter in LINTERS), "python3-pytest"]
    return _PACKAGE_XML.format(
        format=package.format,
        name=package.name,
        description=escape(package.description),
        email=quoteattr(package.email),
        maintainer=escape(package.maintainer),
        license=escape(package.license),
        dependencies=f"{needs}\n" if needs else "",
        test_dependencies="".join(f"  <test_depend>{name}</test_depend>\n" for name in tests),
    )


def setup_py(package: Description) -> str:
    line = f"{package.node} = {package.name}.{package.node}:main"
    return _SETUP_PY.format(
        name=package.name,
        maintainer=package.maintainer,
        email=package.email,
        description=package.description,
        license=package.license,
        scripts=f"            {line!r}\n" if package.node else "",
    )


def setup_cfg(package: Description) -> str:
    return _SETUP_CFG.format(name=package.name)


def node(package: Description) -> str:
    return _NODE.format(name=package.name)


def linter_test(linter: str) -> str:
    return _LINTER_TEST.format(linter=linter)
