"""Runs nodes: joins their inputs, publishes their outputs, keeps time; in one process or many."""
