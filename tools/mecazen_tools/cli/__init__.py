"""The command line: `mecazen --help`."""
