"""Why one flight went wrong, from its log alone."""
