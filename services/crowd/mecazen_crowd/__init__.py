"""Other people: on paths, or reacting to each other, to robots and to obstacles."""
