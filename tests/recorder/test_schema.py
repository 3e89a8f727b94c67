"""The JSON schemas in a recording; ROS's definitions: tests/common/test_cdr.py."""

import msgspec
import pytest
from mecazen.keys import TOPICS
from mecazen_recorder import writer


@pytest.mark.parametrize("kind", sorted({t.type for t in TOPICS}, key=lambda k: k.__name__))
def test_a_json_schema_has_the_message_at_its_root_and_all_that_it_refers_to(kind):
    schema = writer.schema_of(kind, "json")
    table = msgspec.json.decode(schema.data)
    assert (schema.encoding, schema.name) == ("jsonschema", kind.ROS_TYPE)
    assert table["type"] == "object"
    assert tuple(table["properties"]) == kind.__struct_fields__
    references = [part.partition(b'"')[0] for part in schema.data.split(b'"$ref":"#/$defs/')[1:]]
    assert {name.decode() for name in references} <= set(table["$defs"])
