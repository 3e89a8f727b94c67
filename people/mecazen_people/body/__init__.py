"""The person's body: a skeleton that walks, on feet that stay where they stand."""
