"""Copies agree with what they copy: documents, access rules, compose file, folders, pictures."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator

import msgspec.inspect as mi
import pytest
from harness import ROOT
from mecazen.config import Scenario
from mecazen.config.services import AngularLimits, LinearLimits
from mecazen.graph import COLLECTOR, OBSERVERS, SERVICES
from mecazen.loading import load_scenario
from mecazen.schema import fields, members

from docs.pictures import DOCS, PICTURES
from docs.reference import files

OURS = sorted(set(SERVICES) - {COLLECTOR})
FOLDERS = {"crowd": "target"}
"""Folders and images of services whose name is another one."""
FILES = dict(files())


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_a_file_from_the_code_is_up_to_date(path):
    assert path.read_text() == FILES[path], "`make graph` writes it again"


def test_each_service_has_a_container_that_runs_it_and_asks_for_its_health():
    compose = (ROOT / "docker-compose.yml").read_text()
    for service in OURS:
        image = FOLDERS.get(service, service)
        blocks = [b for b in compose.split("\n\n") if f"mecazen.health, {service}]" in b]
        assert len(blocks) == 1, service
        assert f"image: mecazen-{image}\n" in blocks[0]
        assert f"SERVICE: {image}" in blocks[0]
        assert f"run, {service}]" in blocks[0] or f"mecazen run {service}" in blocks[0]


def test_the_containers_of_each_profile_are_the_services_of_its_scenario():
    compose = (ROOT / "docker-compose.yml").read_text()
    names = re.findall(r"^  (?:(teleop|lockstep)-)?(\w+): \{<<: \[\*container", compose, re.M)
    by_profile = {
        profile: {name for prefix, name in names if prefix == profile and name not in OBSERVERS}
        for profile in ("", "teleop", "lockstep")
    }
    paths = (ROOT / "configs" / "scenarios" / f"{name}.toml" for name in ("back", "teleop"))
    back, teleop = (set(load_scenario(path).services) for path in paths)
    assert by_profile == {"": back, "teleop": teleop, "lockstep": back}


MADE = re.compile(r"<!-- by hand: drawn by make pictures -->\n((?:.*!\[[^\]]*\]\([^)]*\).*\n)+)")
"""The comment, and the lines with pictures below it."""
SHOWN = re.compile(r"!\[([^\]]*)\]\(([^)]*)\)")


def shown():
    """Return the files and alternative texts of all pictures that documents say are made."""
    for document in (ROOT / "README.md", *sorted(DOCS.glob("*.md"))):
        for lines in MADE.findall(document.read_text()):
            for text, place in SHOWN.findall(lines):
                yield (document.parent / place).resolve(), text


def test_every_picture_that_a_document_shows_is_made_and_every_one_made_is_shown():
    made = {DOCS / place for place in PICTURES}
    assert {file for file, _ in shown()} == made
    assert all(file.exists() for file in made)
    assert all(text for _, text in shown())


CODE = ("common", "people", "services", "tools", "ros2")


def settings_of(node: mi.Type) -> Iterator[str]:
    """Yield the name of each setting of a table and of the tables within."""
    for kind in members(node):
        if isinstance(kind, mi.VarTupleType):
            yield from settings_of(kind.item_type)
        for name, inner in fields(kind).items():
            if name != "kind":
                yield name
            yield from settings_of(inner)


def test_code_reads_every_setting():
    # the limits are read as a tuple
    read = {*LinearLimits.__struct_fields__, *AngularLimits.__struct_fields__}
    for file in (path for part in CODE for path in (ROOT / part).rglob("*.py")):
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.Attribute):
                read.add(node.attr)
            elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                read |= {*node.value.split(".")}  # the key of a rate, a name for getattr
    assert {*settings_of(mi.type_info(Scenario))} - read == set()
