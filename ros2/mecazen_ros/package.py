"""The ROS 2 package `mecazen_msgs`: messages of topics that ROS does not define."""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path

from mecazen.keys import TOPICS
from mecazen.messages import Message

from mecazen_ros.types import definition, parts

NAME = "mecazen_msgs"

_CMAKE = """\
cmake_minimum_required(VERSION 3.8)
project({name})

find_package(ament_cmake REQUIRED)
find_package(rosidl_default_generators REQUIRED)
{found}

rosidl_generate_interfaces(${{PROJECT_NAME}}
{files}
  DEPENDENCIES {packages}
)

ament_export_dependencies(rosidl_default_runtime)
ament_package()
"""
_MANIFEST = """\
<?xml version="1.0"?>
<package format="3">
  <name>{name}</name>
  <version>{version}</version>
  <description>Messages of mecazen that ROS has no equal for</description>
  <maintainer email="mecazen@example.org">mecazen</maintainer>
  <license>Apache-2.0</license>

  <buildtool_depend>ament_cmake</buildtool_depend>
  <build_depend>rosidl_default_generators</build_depend>
{depends}
  <exec_depend>rosidl_default_runtime</exec_depend>
  <member_of_group>rosidl_interface_packages</member_of_group>

  <export>
    <build_type>ament_cmake</build_type>
  </export>
</package>
"""


def files(folder: Path) -> Iterator[tuple[Path, str]]:
    """Yield each file of the package in `folder`, and its required content."""
    met = dict.fromkeys(kind for topic in TOPICS for kind in parts(topic.type))
    own = sorted((kind for kind in met if _package(kind) == NAME), key=lambda kind: kind.__name__)
    packages = sorted({_package(part) for kind in own for part in parts(kind)} - {NAME})
    for kind in own:
        yield folder / "msg" / f"{kind.__name__}.msg", _documented(kind)
    yield (
        folder / "CMakeLists.txt",
        _CMAKE.format(
            name=NAME,
            found="\n".join(f"find_package({package} REQUIRED)" for package in packages),
            files="\n".join(f'  "msg/{kind.__name__}.msg"' for kind in own),
            packages=" ".join(packages),
        ),
    )
    depends = "\n".join(f"  <depend>{package}</depend>" for package in packages)
    manifest = _MANIFEST.format(name=NAME, version=version("mecazen"), depends=depends)
    yield folder / "package.xml", manifest


def _package(kind: type[Message]) -> str:
    return kind.ROS_TYPE.partition("/")[0]


def _documented(kind: type[Message]) -> str:
    lines = inspect.cleandoc(kind.__doc__ or "").splitlines()
    own = definition(kind).partition("=" * 80)[0]
    return "".join(f"# {line}".rstrip() + "\n" for line in lines) + "\n" + own
