"""The blind benchmark of the diagnosis: hide a cause in flights, ask, and score the answer."""
