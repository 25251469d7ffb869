"""Files and folders that hold recordings."""
