"""An emulated board: its firmware as a program, connected to mecazen's physics."""
