"""Replay: a recorded run fed to the nodes' cores again, and the differences."""
