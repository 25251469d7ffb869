"""For long commands: worker processes, signals, folders of results."""
