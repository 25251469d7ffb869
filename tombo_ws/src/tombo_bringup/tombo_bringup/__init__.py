"""The top of the suite: scenarios, the headless flight, its report and the `tombo` command."""
