"""What the noise of the sensors makes of each channel."""
