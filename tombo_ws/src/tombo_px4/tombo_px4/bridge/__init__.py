"""The bridge to PX4: session, set points, checks before take-off."""
