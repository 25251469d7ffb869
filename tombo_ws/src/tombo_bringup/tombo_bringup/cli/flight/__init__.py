"""Commands about flights: fly, up, px4, hil, replay."""
