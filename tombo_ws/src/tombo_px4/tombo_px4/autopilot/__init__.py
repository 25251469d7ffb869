"""The Tombo vehicle behind an autopilot that answers as PX4 does."""
