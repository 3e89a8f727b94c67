"""A board that is not there: its firmware as a program, in front of mecazen's physics."""
