"""The recorder: what is published, in MCAP files; played back, and computed anew."""
