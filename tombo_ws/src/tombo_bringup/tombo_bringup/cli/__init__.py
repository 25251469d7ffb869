"""The `tombo` command: one file a subcommand."""
