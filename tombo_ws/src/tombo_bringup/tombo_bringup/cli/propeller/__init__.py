"""Commands of `tombo propeller`."""
