"""The commands of `tombo benchmark`."""
