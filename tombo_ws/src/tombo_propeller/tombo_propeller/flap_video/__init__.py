"""The spinning propeller, seen by a camera or by a load cell: flap angle and recovery time."""
