"""The person's body: a walking skeleton whose standing feet stay in place."""
