"""The diagnosis of flights."""
