"""Motion capture: the poses of a tracked body, from any system, as the suite needs them."""
