"""The table of keys: every topic and call once."""

from mecazen import keys, messages


def test_every_topic_and_call_is_in_the_table_once():
    names = [topic.key for topic in keys.TOPICS] + [call.key for call in keys.CALLS]
    assert len(set(names)) == len(names)
    assert not any(name.startswith("/") for name in names)
    for topic in (value for value in vars(keys).values() if isinstance(value, keys.Topic)):
        assert keys.topic_of(topic.key) is topic
        assert keys.resolve(f"two/{topic.key}", keys.TOPICS) == ("two", topic)


def test_the_diagnostics_of_any_service_are_in_the_table():
    assert keys.topic_of("diagnostics/physics").type is messages.DiagnosticArray
    assert keys.diagnostics("physics").key == "diagnostics/physics"
    assert keys.topic_of("diagnostics") is None
    assert keys.topic_of("cmd_vel/more") is None
