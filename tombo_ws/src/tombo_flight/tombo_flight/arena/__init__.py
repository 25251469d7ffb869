"""Every reaction against a set of collisions: what is flown, its figures and its page."""
