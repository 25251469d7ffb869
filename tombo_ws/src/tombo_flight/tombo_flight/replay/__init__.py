"""Replay: a recorded run once more through the nodes' pure cores, and what differs."""
