"""The MAVLink side of the simulated PX4: endpoint, telemetry, parameters, commands."""
